# SPDX-License-Identifier: Apache-2.0
"""Gauss-Newton with ray casting in each step: the one loop of sessions and single views."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from tof_align.bounced import Light, light_in
from tof_align.discrepancy import basis_of, least_sizes
from tof_align.lens import lens_columns
from tof_align.linearise import linearise
from tof_align.mixed import estimate
from tof_align.parts import PART, counts
from tof_align.robust import first_look, halfway, misfit, weigh
from tof_align.system import R, SessionSystem, assemble, unmodelled
from tof_align.view_columns import columns_of
from tof_core.arrays import Float
from tof_core.cores import in_threads
from tof_core.errors import RefusedError
from tof_core.progress import progress

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_align.chain import Rig
    from tof_align.config import AlignConfig
    from tof_align.discrepancy import Basis
    from tof_align.linearise import Linearised
    from tof_align.mixed import Mixed, Normal
    from tof_align.pixels import Pixels
    from tof_scene.raycast import Raycaster

STILL = 2e-6
"""Step of a camera (metres, radians) below which the iteration ends."""
NEAR = 0.5
"""RMS step in standard deviations of the cameras below which the iteration ends. A step is a third of the one before, and the last
linearisation takes one more: a twentieth of a standard deviation remains."""
Columns = Callable[[int, "Linearised"], Float]
"""Extra columns (n, k) of view v at its linearisation, metres of z per unit."""


@dataclass(slots=True, eq=False)
class Fitter:
    """Views to fit once, and what is kept between linearisations: the discrepancy's basis, and what the last weights allowed for.

    _misfits: metres per view; _allowed: metres per kind of the discrepancy.
    """

    pixels: Sequence[Pixels]
    caster: Raycaster
    config: AlignConfig
    columns: Columns | None = None
    theta_std: Float | None = None
    basis: Basis | None = None
    last: Sequence[Pixels] | None = None
    _light: dict[int, Light] = field(default_factory=dict)
    _misfits: dict[int, float] = field(default_factory=dict)
    _allowed: dict[str, float] = field(default_factory=dict)

    def fit(self, rig: R, iterations: int) -> tuple[SessionSystem[R], Mixed, list[Float] | None]:
        """Step at most `iterations` times, until the cameras are near, then linearise and fit once more.

        The last time with the pixels of `last`, if given and if unmodelled errors are below `weights.last_mm`; more pixels would only
        repeat larger ones.

        Returns the last system, its answer (whose step is not taken yet), and the columns.
        """
        answer: Mixed | None = None
        for _ in progress(range(iterations), "poses", iterations + 1):
            system, answer, _ = self.once(rig, answer)
            rig = rig.moved(answer.x, answer.own)
            if _near(system, answer):
                break
        smooth = [size for kind, size in (answer.sizes if answer else {}).items() if kind != "lens" and not kind.startswith(PART)]
        if self.last and max(smooth, default=0.0) < self.config.weights.last_mm * 1e-3:
            self.pixels = self.last
        self._light.clear()  # Computed at the first and last pose: the steps between change it by less than the error of its rays.
        return self.once(rig, answer)

    def once(self, rig: R, before: Mixed | None = None) -> tuple[SessionSystem[R], Mixed, list[Float] | None]:
        """Cast rays, linearise, weigh by the residual of the last answer (the first time: of a free pose), solve."""
        views = tuple(in_threads(lambda v: self._linearised(rig, v), range(len(self.pixels))))
        if not any(len(v.residual) for v in views):
            raise RefusedError("no view sees the CAD", where="alignment", todo="check the scene's frame and the robot's pose")
        self.basis = self.basis or basis_of(views, self.config.discrepancy)
        columns = None if self.columns is None else [self.columns(v, view) for v, view in enumerate(views)]
        system = SessionSystem(rig, views, tuple(np.zeros(0) for _ in views), self.basis, {}, self.theta_std)
        if before is not None:
            self._allowed = {kind: halfway(size, self._allowed.get(kind)) for kind, size in before.sizes.items()}
        weighed = in_threads(lambda v: self._weighed(system, before, columns, v), range(len(views)))
        theta_info = system.theta_info(0 if columns is None else columns[0].shape[1])
        answer = self._solve(assemble([gram for _, gram in weighed], rig, self.basis, theta_info), self.basis)
        return replace(system, weights=tuple(w for w, _ in weighed), sizes=answer.sizes), answer, columns

    def _linearised(self, rig: Rig, v: int) -> Linearised:
        view, of = linearise(self.pixels[v], rig.pose(v), self.caster, self.config.weights), self.config.discrepancy
        if of.enabled and of.lens:
            view = replace(view, lens=lens_columns(view, self.pixels[v].camera))
        if not (of.enabled and of.bounces):
            return view
        if v not in self._light:
            self._light[v] = light_in(view, self.pixels[v], self.caster)
        return replace(view, bounced=self._light[v].over(view, self.pixels[v]))

    def _weighed(self, system: SessionSystem[R], before: Mixed | None, columns: list[Float] | None, v: int) -> tuple[Float, Float]:
        view, limits = system.views[v], self.config.weights.shared
        of = columns_of(view, system.basis, None if columns is None else columns[v])
        if before is None:
            weight = weigh(view, first_look(view, limits), self.config.weights)
        else:
            smooth = unmodelled(of, system.rig, system.basis, before, v)
            left = view.residual - smooth.sum(axis=1) - of.of_extra(before.x[system.rig.globals_ + sum(system.basis.shared) :])
            self._misfits[v] = halfway(misfit(smooth, limits), self._misfits.get(v))
            weight = weigh(view, left, self.config.weights, self._misfits[v], of.beyond(self._allowed, limits))
        weight = weight * counts(system.basis.parts, view)
        return weight, of.gram(weight)

    def _solve(self, normal: Normal, basis: Basis) -> Mixed:
        """Solve with the sizes of maximum likelihood, from the same start in every linearisation: a kind once near zero would stay there."""
        d = self.config.discrepancy
        start = {kind: (d.part_start_mm if kind.startswith(PART) else d.start_mm) * 1e-3 for kind in (*normal.kinds, *normal.own_kinds)}
        return estimate(normal, start, rounds=d.rounds, low=least_sizes(start, basis, d), high=d.ceiling_mm * 1e-3)


def _near(system: SessionSystem[R], answer: Mixed) -> bool:
    """Whether the steps of all cameras are below `STILL`, or their RMS, in standard deviations of the cameras, is below `NEAR`."""
    steps = system.camera_steps(answer)
    if float(np.abs(steps).max()) < STILL:
        return True
    deviations = np.sqrt([np.diag(system.camera_cov(answer, v)) for v in range(len(steps))])
    return float(np.sqrt(np.mean((steps / deviations) ** 2))) < NEAR
