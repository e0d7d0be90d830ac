# SPDX-License-Identifier: Apache-2.0
"""Fixed pattern as columns: smooth fields, and the lines that other views of the same raster show."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import uniform_filter

from tof_sensor.effects.fixed_pattern import cosines

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Float, Ints, Mask
    from tof_gap.evidence import ViewEvidence

WINDOW_PX = 15
"""Lines are what stands out of a neighbourhood this wide."""


def pattern_columns(views: Sequence[ViewEvidence], v: int, folds: Ints, order: int) -> Float:
    """(n, order^2) on a view's drawn pixels: cosines, then the lines seen in views of other folds.

    The last column is estimated without the fold that it is judged on, so a held-out score of it
    is honest; its coefficient is 1 where the pattern is real.
    """
    view = views[v]
    h, w = view.residual.shape
    by_column, by_row = lines([other for other, fold in zip(views, folds, strict=True) if fold != folds[v]])
    row, column = np.divmod(view.pixels, w)
    smooth = cosines(h, w, order)[row, column]
    seen = (by_column[column] + by_row[row])[:, None]
    return np.concatenate([smooth, seen], axis=1) / view.frame.length.ravel()[view.pixels, None]


def lines(views: Sequence[ViewEvidence]) -> tuple[Float, Float]:
    """(W,), (H,) metres along the ray: mean of the high-passed residual by column and by row."""
    total = np.zeros(views[0].residual.shape)
    weight = np.zeros_like(total)
    for view in views:
        high = high_pass(view.residual * view.frame.length, view.smooth)
        inverse = np.where(np.isfinite(high), 1.0 / view.sigma**2, 0.0)
        total += inverse * np.nan_to_num(high)
        weight += inverse
    by_column = total.sum(axis=0) / np.maximum(weight.sum(axis=0), 1e-12)
    rest = total - weight * by_column[None]
    return by_column, rest.sum(axis=1) / np.maximum(weight.sum(axis=1), 1e-12)


def high_pass(image: Float, mask: Mask) -> Float:
    """(H, W) image less its local mean over the mask; NaN outside."""
    inside = mask.astype(float)
    share = uniform_filter(inside, WINDOW_PX)
    mean = uniform_filter(np.where(mask, image, 0.0), WINDOW_PX) / np.maximum(share, 1e-9)
    return np.where(mask, image - mean, np.nan)
