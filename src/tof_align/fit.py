# SPDX-License-Identifier: Apache-2.0
"""Gauss-Newton with casting between the steps: the one loop behind sessions and single views."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from tof_align.discrepancy import basis_of
from tof_align.linearise import linearise
from tof_align.mixed import estimate
from tof_align.robust import first_look, weigh
from tof_align.system import R, SessionSystem
from tof_core.arrays import Float
from tof_core.errors import RefusedError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_align.config import AlignConfig
    from tof_align.linearise import Linearised
    from tof_align.mixed import Mixed
    from tof_align.pixels import Pixels
    from tof_scene.raycast import Raycaster

Columns = Callable[[int, "Linearised"], Float]
"""Extra columns (n, k) of view v at its linearisation, metres of z per unit."""


@dataclass(slots=True, eq=False)
class Fitter:
    """Views to fit, and what stays warm between linearisations (the discrepancy's sizes)."""

    pixels: Sequence[Pixels]
    caster: Raycaster
    config: AlignConfig
    columns: Columns | None = None
    theta_std: Float | None = None
    sizes: dict[str, float] | None = None

    def fit(self, rig: R, iterations: int) -> tuple[SessionSystem[R], Mixed, list[Float] | None]:
        """Step `iterations` times, then linearise and fit once more at the end.

        Returns the last system, its answer (whose step is not taken yet), and the columns.
        """
        for _ in range(iterations):
            system, answer, _ = self.once(rig)
            rig = rig.moved(answer.x, answer.own)
            if float(np.abs(system.camera_steps(answer)).max()) < 2e-6:
                break
        return self.once(rig)

    def once(self, rig: R) -> tuple[SessionSystem[R], Mixed, list[Float] | None]:
        """Cast, linearise, weigh, solve; weigh anew by what is left, solve again."""
        views = tuple(linearise(p, rig.pose(v), self.caster, self.config.weights) for v, p in enumerate(self.pixels))
        if not any(len(v.residual) for v in views):
            raise RefusedError("no view sees the CAD", where="alignment", todo="check the scene's frame and the robot's pose")
        columns = None if self.columns is None else [self.columns(v, view) for v, view in enumerate(views)]
        weights = tuple(weigh(v, first_look(v), self.config.weights) for v in views)
        basis = basis_of(views, self.config.discrepancy)
        system = SessionSystem(rig, views, weights, basis, {}, self.theta_std)
        answer = self._solve(system, columns)
        left = system.remaining(answer, columns)
        weights = tuple(weigh(v, e, self.config.weights) for v, e in zip(views, left, strict=True))
        system = replace(system, weights=weights)
        answer = self._solve(system, columns)
        return replace(system, sizes=answer.sizes), answer, columns

    def _solve(self, system: SessionSystem[R], columns: list[Float] | None) -> Mixed:
        d = self.config.discrepancy
        normal = system.normal(columns)
        warm = self.sizes or {}
        sizes = {kind: warm.get(kind, d.start_mm * 1e-3) for kind in (*normal.kinds, *normal.own_kinds)}
        answer = estimate(normal, sizes, rounds=d.rounds, low=d.floor_mm * 1e-3, high=d.ceiling_mm * 1e-3)
        self.sizes = dict(answer.sizes)
        return answer


