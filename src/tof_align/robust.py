# SPDX-License-Identifier: Apache-2.0
"""Robust weights: gross disagreement (a missing part, a foreign object) must not pull."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tof_align.discrepancy import LOCAL, SHARED, inflation
from tof_core.stats import robust_std

if TYPE_CHECKING:
    from tof_align.config import WeightConfig
    from tof_align.limits import SharedLimits
    from tof_align.linearise import Linearised
    from tof_core.arrays import Float

LEAST_SPREAD_M = 1e-4
"""Spread of residuals that are all equal: keeps a division finite."""
RIDGE = 1e-6
"""Of the mean diagonal: keeps the step of a view that sees one plane finite."""


def _wrong_shares(limits: SharedLimits) -> Float:
    """(kinds,) share of each kind of discrepancy that is taken to be wrong, in the order of `SHARED` and `LOCAL`.

    Small for a function of a measured number, large for one view's own; a constant is a part of the pose's error, and of errors
    that stick to the surface the wrong part is known (`beyond_columns`).
    """
    shares = {"range": limits.measured, "amplitude": limits.measured, "image": limits.image, "bend": limits.view, "smooth": limits.view}
    return np.array([shares.get(kind, 0.0) for kind in (*SHARED, *LOCAL)])


def tukey(error: Float, width: Float | float) -> Float:
    """Tukey's biweight: (1 - (e/c)^2)^2 inside, 0 outside."""
    u = error / width
    return np.where(np.abs(u) < 1.0, (1.0 - u * u) ** 2, 0.0)


def kernel_width(view: Linearised, error: Float, config: WeightConfig) -> Float:
    """(n,) metres beyond which a pixel does not count, from what the fit leaves (n,)."""
    scale = np.maximum(view.sigma, robust_std(error))
    return np.maximum(config.kernel * scale, config.kernel_floor_mm * 1e-3)


def weigh(
    view: Linearised, error: Float, config: WeightConfig, explained: Float | None = None, beyond_columns: Float | float = 0.0
) -> Float:
    """(n,) inverse variances, 1/m^2: robust, and honest about neighbours that err together.

    error (n,): metres after the fit; explained (n, kinds): metres that it attributes to the discrepancy; beyond_columns (n,): standard
    deviation of what the discrepancy's columns cannot describe, metres. Of what is explained a share
    is taken to be wrong (`SharedLimits`); both errors are alike within a patch of the image: columns never
    describe all of an unmodelled error, and thousands of pixels would turn the missing part into a pose.
    """
    if not len(error):
        return np.zeros(0)
    shared = config.shared
    accept = tukey(error, kernel_width(view, error, config))
    weight = accept / view.sigma**2
    misfit = 0.0 if explained is None else float(np.linalg.norm(explained.std(axis=0) * _wrong_shares(shared)))
    patch = view.raster[0] * view.raster[1] / shared.patches
    return np.asarray(accept / (inflation(view, error, weight, shared) * view.sigma**2 + patch * (misfit**2 + np.square(beyond_columns))))


def first_look(view: Linearised, limits: SharedLimits) -> Float:
    """(n,) metres after one robust step of a free pose: residuals to weigh by before anything is fitted."""
    if len(view.residual) < limits.first_pixels:
        return view.residual
    scale = float(np.median(np.abs(view.residual - np.median(view.residual)))) + LEAST_SPREAD_M
    root = 1.0 / (1.0 + (view.residual / (limits.first_sigma * scale)) ** 2)
    J = view.jacobian * root[:, None]
    xi = np.linalg.solve(J.T @ J + RIDGE * np.trace(J.T @ J) / 6 * np.eye(6), J.T @ (root * view.residual))
    return np.asarray(view.residual - view.jacobian @ xi)
