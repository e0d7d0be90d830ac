# SPDX-License-Identifier: Apache-2.0
"""A reference session of the complete cell: where each part seemed to stand when it stood in its place."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import eigh
from scipy.special import gammaincinv

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from tof_core.arrays import Float
    from tof_inspect.config import InspectConfig
    from tof_inspect.displaced import Fit

NEAR_M = 0.15
"""Distance of two cameras that see a part from about the same place: three times the stopping accuracy of a base."""
SHARE = 0.5
"""Share of the views of a part that have such a neighbour in the reference session."""
SURE = 0.05
"""Share of chance beyond the largest scale of the camera's errors."""
SCALES = np.append(0.0, np.geomspace(1e-4, 1e2, 121))
"""Scales that are tried, in steps of an eighth."""


@dataclass(frozen=True, slots=True, eq=False)
class Standing:
    """A part in a session: its fit, and where the cameras stood that saw it (n, 3)."""

    fit: Fit
    cameras: Float


@dataclass(frozen=True, eq=False)
class ReferenceSession:
    """Parts by name, as the reference session has them; digest of its scene."""

    parts: Mapping[str, Standing]

    def relative(self, name: str, fit: Fit, cameras: Sequence[Float], config: InspectConfig) -> Fit:
        """The part's motion since the reference session, where that saw it from about the same places; else the fit as it is."""
        then = self.parts.get(name)
        if then is None or not len(cameras):
            return fit
        apart = np.linalg.norm(np.asarray(cameras)[:, None] - then.cameras[None], axis=2).min(axis=1)
        return fit.relative_to(then.fit, self.scale, config) if (apart < NEAR_M).mean() >= SHARE else fit

    @cached_property
    def scale(self) -> tuple[float, float]:
        """`scale_of` all parts of the session."""
        return scale_of([s.fit for s in self.parts.values()])


def scale_of(fits: Sequence[Fit]) -> tuple[float, float]:
    """Variance of the camera's errors over the stated one, most likely and at most, by shifts of parts that stand in their place.

    The stated one is what the camera may do; how much it does is the same for all parts.
    """
    squares, sizes = np.zeros(0), np.zeros(0)
    for f in fits:
        size, axes = (
            eigh(f.known.T @ f.repeats @ f.known, f.known.T @ f.own @ f.known) if f.known.shape[1] else (np.zeros(0), np.zeros((0, 0)))
        )
        squares = np.append(squares, np.square(axes.T @ (f.known.T @ f.shift)))
        sizes = np.append(sizes, np.maximum(size, 0.0))
    free = len(squares)
    if not free:
        return 1.0, 1.0
    scatter = (squares / (1.0 + np.outer(SCALES, sizes))).sum(axis=1)  # falls with the scale

    def reached(wanted: float) -> float:
        """The scale at which the scatter is what is wanted."""
        return float(np.interp(-wanted, -scatter, SCALES))

    return reached(float(free)), reached(2.0 * float(gammaincinv(0.5 * free, SURE)))
