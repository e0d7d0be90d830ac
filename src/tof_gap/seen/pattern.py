# SPDX-License-Identifier: Apache-2.0
"""Fixed pattern as columns: smooth fields, and the lines that other views of the same raster show; and its single pixels."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import uniform_filter

from tof_gap.seen.residual import depth_step, scatter
from tof_sensor.effects.fixed_pattern import cosines

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Float, Ints, Mask
    from tof_gap.seen.residual import ViewEvidence

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


@dataclass(frozen=True, slots=True, eq=False)
class Pixels:
    """What single pixels err by in every view alike.

    image: (H, W) metres along the ray, drawn to zero as far as scatter may have made it; size_m: how large such errors are (RMS);
    unsure2: (H, W) m^2 that the image may itself be wrong by.
    """

    image: Float
    size_m: float
    unsure2: Float


def single_pixels(views: Sequence[ViewEvidence]) -> Pixels:
    """Means over the views of the high-passed residual less its lines, each weighed against the scatter of that mean."""
    by_column, by_row = lines(views)
    sharp, weight = [], []
    for view in views:
        r = high_pass(view.residual * view.frame.length, view.smooth) - by_column[None] - by_row[:, None]
        sharp.append(np.nan_to_num(r))
        weight.append(np.where(np.isfinite(r), (view.sigma * view.frame.length) ** -2.0, 0.0))
    high, w = np.stack(sharp), np.stack(weight)
    halves = [(w[i::2] * high[i::2]).sum(axis=0) / np.maximum(w[i::2].sum(axis=0), 1e-12) for i in (0, 1)]
    both = (w[0::2].sum(axis=0) > 0) & (w[1::2].sum(axis=0) > 0)
    size2, error2 = in_common(halves[0][both], halves[1][both])
    if size2 <= 0 or size2 < SURE * error2:
        return Pixels(np.zeros(both.shape), 0.0, np.zeros(both.shape))
    total, n = w.sum(axis=0), np.maximum((w > 0).sum(axis=0), 1)
    # The scatter that neighbours show has the pattern in it.
    scatter2 = np.maximum(n / np.maximum(total, 1e-12) - size2, 0.1 * size2) / n
    trust = np.where(total > 0, size2 / (size2 + scatter2), 0.0)
    mean = (w * high).sum(axis=0) / np.maximum(total, 1e-12)
    return Pixels(trust * mean, float(np.sqrt(size2)), size2 * (1.0 - trust))


def in_common(one: Float, other: Float) -> tuple[float, float]:
    """m^2 of what two halves of the views say of the same pixels alike, and its error; 0 of too few pixels.

    The halves share the pattern and nothing else that is white: their covariance is its variance.
    """
    product = one * other
    if len(product) < ENOUGH_PIXELS:
        return 0.0, 0.0
    product = np.clip(product, *np.quantile(product, [0.002, 0.998]))
    return float(product.mean()), float(product.std() / np.sqrt(len(product)))


SURE = 4.0
"""Of its own error, what the variance of single pixels must reach to be one."""
ENOUGH_PIXELS = 200
"""Pixels that both halves of the views see below which nothing is said of single ones."""


def without_pattern(views: Sequence[ViewEvidence], bias: Sequence[Float], unsure2: Float, fit_views: Sequence[int]) -> list[ViewEvidence]:
    """The views with the scatter that is left once the pattern's (H, W) `bias` of each is taken off.

    What the pattern is wrong by (`unsure2`) adds to what is seen of a view, and is as much missing where the view itself told it.
    """
    out = []
    for v, (view, b) in enumerate(zip(views, bias, strict=True)):
        seen = scatter(view.residual - b, view.smooth, view.frame.amplitude)
        own = depth_step(view.view.depth.astype(np.float64)) / np.sqrt(12)
        wrong2 = (-unsure2 if v in fit_views else unsure2) / view.frame.length**2
        sigma2 = np.maximum(seen**2 - wrong2, 0.25 * seen**2)
        out.append(replace(view, sigma=np.maximum(np.sqrt(sigma2), own)))
    return out


def high_pass(image: Float, mask: Mask) -> Float:
    """(H, W) image less its local mean over the mask; NaN outside."""
    inside = mask.astype(float)
    share = uniform_filter(inside, WINDOW_PX)
    mean = uniform_filter(np.where(mask, image, 0.0), WINDOW_PX) / np.maximum(share, 1e-9)
    return np.where(mask, image - mean, np.nan)
