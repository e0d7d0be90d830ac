# SPDX-License-Identifier: Apache-2.0
"""Robust weights: gross disagreement (a missing part, a foreign object) must not pull."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tof_align.discrepancy import inflation

if TYPE_CHECKING:
    from tof_align.config import WeightConfig
    from tof_align.linearise import Linearised
    from tof_core.arrays import Float


MISFIT = np.array([0.05, 0.05, 0.0, 0.05, 0.0, 0.3, 0.3])
"""Share of what each kind explains that is taken to be wrong: small for a function of one
measured number, large for what is one view's own; of what sticks to the surface it is known (`unsaid`)."""


def mad(values: Float) -> float:
    """Robust standard deviation about the median; 0 for no values."""
    if not len(values):
        return 0.0
    return float(1.4826 * np.median(np.abs(values - np.median(values))))


def tukey(error: Float, width: Float | float) -> Float:
    """Tukey's biweight: (1 - (e/c)^2)^2 inside, 0 outside."""
    u = error / width
    return np.where(np.abs(u) < 1.0, (1.0 - u * u) ** 2, 0.0)


def kernel_width(view: Linearised, error: Float, config: WeightConfig) -> Float:
    """(n,) metres beyond which a pixel does not count, from what the fit leaves (n,)."""
    scale = np.maximum(view.sigma, mad(error))
    return np.maximum(config.kernel * scale, config.kernel_floor_mm * 1e-3)


def weigh(view: Linearised, error: Float, config: WeightConfig, explained: Float | None = None, unsaid: Float | float = 0.0) -> Float:
    """(n,) inverse variances, 1/m^2: robust, and honest about neighbours that err together.

    error (n,): what the fit left, metres; explained (n, kinds): what it put down to the discrepancy;
    unsaid (n,): deviation of what the discrepancy's columns cannot say. Of what is explained a share
    (`MISFIT`) is taken to be explained wrongly; both are alike within each sixteenth of the image:
    columns never say all about an error nobody knows, and thousands of pixels would turn the missing
    part into a pose.
    """
    if not len(error):
        return np.zeros(0)
    accept = tukey(error, kernel_width(view, error, config))
    weight = accept / view.sigma**2
    misfit = 0.0 if explained is None else float(np.linalg.norm(explained.std(axis=0) * MISFIT))
    patch = view.raster[0] * view.raster[1] / 16.0
    return np.asarray(accept / (inflation(view, error, weight) * view.sigma**2 + patch * (misfit**2 + np.square(unsaid))))


def first_look(view: Linearised) -> Float:
    """(n,) metres that one robust step of a free pose leaves: what to weigh by before anything is fitted."""
    if len(view.residual) < 12:
        return view.residual
    scale = float(np.median(np.abs(view.residual - np.median(view.residual)))) + 1e-4
    root = 1.0 / (1.0 + (view.residual / (3 * scale)) ** 2)
    J = view.jacobian * root[:, None]
    xi = np.linalg.solve(J.T @ J + 1e-6 * np.trace(J.T @ J) / 6 * np.eye(6), J.T @ (root * view.residual))
    return np.asarray(view.residual - view.jacobian @ xi)
