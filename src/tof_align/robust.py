# SPDX-License-Identifier: Apache-2.0
"""Robust weights, so that gross errors (a missing part, a foreign object) have no influence."""

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
"""Least spread of residuals, so that a division stays finite."""
LEAST_ALLOWED_M = 1e-7
"""Metres below which a deviation counts as this much in a geometric mean; its effect on a weight is below a thousandth."""
RIDGE = 1e-6
"""Ridge as a share of the mean diagonal, so that the step of a view of one plane stays finite."""


def _wrong_shares(limits: SharedLimits) -> Float:
    """(kinds,) share of each fitted kind of discrepancy that is assumed wrong, in the order of `SHARED` and `LOCAL`.

    Small for functions of a measured quantity, large for errors of one view. 0 for a constant, which is part of the pose's error, and for
    errors that belong to the surface, whose wrong share is known (`beyond_columns`).
    """
    shares = {"range": limits.measured, "amplitude": limits.measured, "image": limits.image, "bend": limits.view, "smooth": limits.view}
    return np.array([shares.get(kind, 0.0) for kind in (*SHARED, *LOCAL)])


def tukey(error: Float, width: Float | float) -> Float:
    """Tukey's biweight: (1 - (e/c)^2)^2 inside, 0 outside."""
    u = error / width
    return np.where(np.abs(u) < 1.0, (1.0 - u * u) ** 2, 0.0)


def kernel_width(view: Linearised, error: Float, config: WeightConfig) -> Float:
    """(n,) metres beyond which a pixel does not count, from the residuals (n,) of the fit."""
    scale = np.maximum(view.sigma, robust_std(error))
    return np.maximum(config.kernel * scale, config.kernel_floor_mm * 1e-3)


def misfit(explained: Float, limits: SharedLimits) -> float:
    """Metres, standard deviation of the errors of a fitted discrepancy, of which a share is assumed wrong (`SharedLimits`).

    explained (n, kinds): metres that the fit attributes to the discrepancy.
    """
    return float(np.linalg.norm(explained.std(axis=0) * _wrong_shares(limits))) if len(explained) else 0.0


def halfway(value: float, last: float | None) -> float:
    """Geometric mean of a deviation in metres and of that of the last linearisation (None: the first).

    A larger discrepancy lowers the weights, and lower weights leave less of it. Taken in full, such a step overshoots: without the mean
    the two alternate from one linearisation to the next, and poses with them.
    """
    return value if last is None else float(np.sqrt(max(value, LEAST_ALLOWED_M) * max(last, LEAST_ALLOWED_M)))


def weigh(view: Linearised, error: Float, config: WeightConfig, misfit_m: float = 0.0, beyond_columns: Float | float = 0.0) -> Float:
    """(n,) inverse variances, 1/m^2: robust, and reduced where neighbours share errors.

    error (n,): metres after the fit; misfit_m: standard deviation in metres of errors of the fitted discrepancy (`misfit`);
    beyond_columns (n,): the same of errors that the discrepancy's columns cannot describe. Both are equal within a patch of the image:
    columns never describe an unmodelled error completely, and thousands of pixels would turn the rest into an error of the pose.
    """
    if not len(error):
        return np.zeros(0)
    shared = config.shared
    accept = tukey(error, kernel_width(view, error, config))
    weight = accept / view.sigma**2
    patch = view.raster[0] * view.raster[1] / shared.patches
    return np.asarray(accept / (inflation(view, error, weight, shared) * view.sigma**2 + patch * (misfit_m**2 + np.square(beyond_columns))))


def first_look(view: Linearised, limits: SharedLimits) -> Float:
    """(n,) metres: residuals after one robust step of a free pose, for the first weights."""
    if len(view.residual) < limits.first_pixels:
        return view.residual
    scale = float(np.median(np.abs(view.residual - np.median(view.residual)))) + LEAST_SPREAD_M
    root = 1.0 / (1.0 + (view.residual / (limits.first_sigma * scale)) ** 2)
    J = view.jacobian * root[:, None]
    xi = np.linalg.solve(J.T @ J + RIDGE * np.trace(J.T @ J) / 6 * np.eye(6), J.T @ (root * view.residual))
    return np.asarray(view.residual - view.jacobian @ xi)
