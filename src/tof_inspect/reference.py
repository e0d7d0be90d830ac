# SPDX-License-Identifier: Apache-2.0
"""A reference session of the complete cell: the measured displacement of parts that are in their place, due to the camera's errors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import eigh
from scipy.special import gammaincinv

from tof_inspect.displaced import Fit, known_axes

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from tof_core.arrays import Float
    from tof_inspect.config import InspectConfig

NEAR_M = 0.15
"""Largest distance in metres of two cameras that count as at the same place: three times the stopping accuracy of a base."""
SHARE = 0.5
"""Least share of a part's views with a camera of the reference session at the same place."""
CHANCE = 0.05
"""Probability of a larger displacement by the stated errors, below which the camera's errors count as larger than stated."""
SCALES = np.geomspace(1.0, 1e4, 161)
"""Scales of the stated variance that are tried: errors up to a hundred times as large as stated, in steps of 3 %."""


@dataclass(frozen=True, slots=True, eq=False)
class Standing:
    """A part in a session: its fit, and the positions (n, 3) in the cell of the cameras that saw it."""

    fit: Fit
    cameras: Float


@dataclass(frozen=True, slots=True, eq=False)
class ReferenceSession:
    """The parts of the reference session by name."""

    parts: Mapping[str, Standing]

    def relative(self, name: str, fit: Fit, cameras: Sequence[Float], config: InspectConfig) -> Fit:
        """The part's motion since the reference session if its cameras were at the same places; otherwise the fit unchanged."""
        then = self.parts.get(name)
        if then is None or not len(cameras):
            return fit
        apart = np.linalg.norm(np.asarray(cameras)[:, None] - then.cameras[None], axis=2).min(axis=1)
        return relative(fit, then.fit, config) if (apart < NEAR_M).mean() >= SHARE else fit


def relative(now: Fit, then: Fit, config: InspectConfig) -> Fit:
    """A part's motion minus the error estimated from a reference session in which the part was in its place.

    Errors common to pixels (of the camera, and of poses at the same places) may occur in both sessions; noise and outline errors are
    independent. The estimated error is the reference's shift times the gain of least variance; its remaining variance is part of sigma.
    A reference shift within its noise changes nothing; a shift far beyond all stated errors is removed completely.
    """
    scale, own = least_scale(then), then.noise + then.outline
    gain = np.zeros((3, 3))
    if then.known.shape[1]:
        repeats, new = (then.known.T @ cov @ then.known for cov in (scale * then.shared, own))
        gain = then.known @ np.linalg.solve(repeats + new, repeats).T @ then.known.T
    left = np.eye(3) - gain
    noise, outline = (a + gain @ b @ gain.T for a, b in ((now.noise, then.noise), (now.outline, then.outline)))
    shared = left @ (scale * now.shared) @ left.T
    known = now.known @ known_axes(now.known.T @ (noise + outline + shared) @ now.known, config)
    return Fit(known @ (known.T @ (now.shift - gain @ then.shift)), noise, outline, shared, known, now.ratio)


def least_scale(fit: Fit) -> float:
    """Least scale (1 or more) of the variance of the shared errors with which the shift of a part in its place is within chance."""
    K = fit.known
    if not K.shape[1]:
        return 1.0
    sizes, axes = eigh(K.T @ fit.shared @ K, K.T @ (fit.noise + fit.outline) @ K)
    squares = np.square(axes.T @ K.T @ fit.shift)
    chi2 = (squares / (1.0 + np.outer(SCALES, np.maximum(sizes, 0.0)))).sum(axis=1)
    allowed = 2.0 * float(gammaincinv(0.5 * K.shape[1], 1.0 - CHANCE))
    return float(SCALES[min(int((chi2 > allowed).sum()), len(SCALES) - 1)])
