# SPDX-License-Identifier: Apache-2.0
"""A reference session of the complete cell: where each part seemed to stand when it stood in its place."""

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
"""Distance of two cameras that see a part from about the same place: three times the stopping accuracy of a base."""
SHARE = 0.5
"""Share of the views of a part that have such a neighbour in the reference session."""
CHANCE = 0.05
"""Share of chance beyond which a shift of the reference session shows that the camera errs there by more than is stated."""
SCALES = np.geomspace(1.0, 1e4, 161)
"""Scales of the stated variance that are tried: up to an error a hundred times as large as stated, in steps of 3 % of its size."""


@dataclass(frozen=True, slots=True, eq=False)
class Standing:
    """A part in a session: its fit, and where the cameras stood that saw it (n, 3)."""

    fit: Fit
    cameras: Float


@dataclass(frozen=True, slots=True, eq=False)
class ReferenceSession:
    """Parts by name, as the reference session has them; digest of its scene."""

    parts: Mapping[str, Standing]

    def relative(self, name: str, fit: Fit, cameras: Sequence[Float], config: InspectConfig) -> Fit:
        """The part's motion since the reference session, where that saw it from about the same places; else the fit as it is."""
        then = self.parts.get(name)
        if then is None or not len(cameras):
            return fit
        apart = np.linalg.norm(np.asarray(cameras)[:, None] - then.cameras[None], axis=2).min(axis=1)
        return relative(fit, then.fit, config) if (apart < NEAR_M).mean() >= SHARE else fit


def relative(now: Fit, then: Fit, config: InspectConfig) -> Fit:
    """A part's motion less the error that a reference session shows, in which the part stood in its place.

    What pixels share (the camera's errors, and poses from about the same places) may be in both sessions; noise and outlines are new in
    each. So that error is the reference's shift times a gain of least variance, and what the gain does not remove stays in sigma: a
    reference that shows only its own noise changes nothing, one that shows an error beyond all that is stated is removed as a whole.
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
    """Least scale of the variance of the shared errors, from 1, at which the shift of a part in its place is no more than chance allows."""
    K = fit.known
    if not K.shape[1]:
        return 1.0
    sizes, axes = eigh(K.T @ fit.shared @ K, K.T @ (fit.noise + fit.outline) @ K)
    squares = np.square(axes.T @ K.T @ fit.shift)
    chi2 = (squares / (1.0 + np.outer(SCALES, np.maximum(sizes, 0.0)))).sum(axis=1)
    allowed = 2.0 * float(gammaincinv(0.5 * K.shape[1], 1.0 - CHANCE))
    return float(SCALES[min(int((chi2 > allowed).sum()), len(SCALES) - 1)])
