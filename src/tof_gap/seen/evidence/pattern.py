# SPDX-License-Identifier: Apache-2.0
"""Fixed pattern: columns of smooth fields and of lines, and offsets of single pixels."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from scipy.ndimage import uniform_filter

from tof_gap.seen.evidence.residual import noise_again
from tof_sensor.effects.fixed_pattern import cosines, line_cosines

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from tof_core.arrays import Float, Ints
    from tof_gap.limits.evidence import PatternLimits
    from tof_gap.seen.evidence.view import ViewEvidence
    from tof_sensor.effects.fixed_pattern import FixedPattern


Mean = TypeVar("Mean")


def pattern_columns(view: ViewEvidence, seen: LineMeans, areas: Float, pattern: FixedPattern) -> Float:
    """(n, k) at a view's drawn pixels: cosines of the field, of columns and of rows, then areas and lines of the views in other folds.

    Forms with blocks of columns and rows have a column for `areas` (H, W), metres along the ray. The last two columns are estimated
    without the fold that judges them, so their held-out score is not biased; their coefficients are 1 where the pattern is real.
    """
    h, w = view.residual.shape
    by_column, by_row = seen
    row, column = np.divmod(view.pixels, w)
    smooth = cosines(h, w, pattern.order)[row, column]
    blocks = [line_cosines(n, pattern.order, pattern.lines)[at] for n, at in ((w, column), (h, row))]
    of_areas = areas.ravel()[view.pixels, None] if pattern.lines else np.zeros((len(row), 0))
    lines = (by_column[column] + by_row[row])[:, None]
    return np.concatenate([smooth, *blocks, of_areas, lines], axis=1) / view.frame.length.ravel()[view.pixels, None]


LineMeans = tuple["Float", "Float"]
"""(W,), (H,) metres along the ray: mean of the high-passed residual by column and by row."""


def line_means(views: Sequence[ViewEvidence]) -> LineMeans:
    """Line means over all views."""
    return _means(*weighted_sums(views, high_pass))


def line_means_of_others(views: Sequence[ViewEvidence], folds: Ints) -> list[LineMeans]:
    """For each view, the line means over the views of all other folds; folds (V,): fold of each view."""
    return of_others(views, folds, high_pass, _means)


def of_others(
    views: Sequence[ViewEvidence], folds: Ints, image: Callable[[ViewEvidence], Float], mean: Callable[[Float, Float], Mean]
) -> list[Mean]:
    """For each view, the `mean` of `weighted_sums` over the views of all other folds; folds (V,): fold of each view."""
    names, fold = np.unique(folds, return_inverse=True)
    # Summed over the others, not subtracted from the total: without a pixel in the others the weight is exactly zero.
    sums = [weighted_sums([v for v, mine in zip(views, fold, strict=True) if mine == f], image) for f in range(len(names))]
    none = np.zeros(views[0].residual.shape)
    means = []
    for f in range(len(names)):
        others = [of_one for g, of_one in enumerate(sums) if g != f]
        means.append(mean(sum((t for t, _ in others), none), sum((w for _, w in others), none)))
    return [means[f] for f in fold]


def weighted_sums(views: Sequence[ViewEvidence], image: Callable[[ViewEvidence], Float]) -> tuple[Float, Float]:
    """(H, W) sums over the views of an image of each, NaN where it has no pixel, weighted by inverse variance, and of the weights."""
    total = np.zeros(views[0].residual.shape)
    weight = np.zeros_like(total)
    for view in views:
        of_view = image(view)
        inverse = np.where(np.isfinite(of_view), 1.0 / view.sigma**2, 0.0)
        total += inverse * np.nan_to_num(of_view)
        weight += inverse
    return total, weight


def _means(total: Float, weight: Float) -> LineMeans:
    by_column = total.sum(axis=0) / np.maximum(weight.sum(axis=0), 1e-12)
    rest = total - weight * by_column[None]
    return by_column, rest.sum(axis=1) / np.maximum(weight.sum(axis=1), 1e-12)


@dataclass(frozen=True, slots=True, eq=False)
class PixelOffsets:
    """Offsets of single pixels, alike in every view.

    image: (H, W) metres along the ray, shrunk towards zero by the share of noise in it; size_m: their RMS;
    unsure2: (H, W) m^2, variance of the image's own error.
    """

    image: Float
    size_m: float
    unsure2: Float


def single_pixels(views: Sequence[ViewEvidence]) -> PixelOffsets:
    """Means over the views of the high-passed residual less its lines, weighted by inverse variance."""
    limits = views[0].limits.pattern
    by_column, by_row = line_means(views)
    # Sums over each half of the views, one view after the other: the images of all views take gigabytes.
    product, weight, number = (np.zeros((2, *views[0].residual.shape)) for _ in range(3))
    for v, view in enumerate(views):
        r = high_pass(view) - by_column[None] - by_row[:, None]
        w = np.where(np.isfinite(r), (view.sigma * view.frame.length) ** -2.0, 0.0)
        product[v % 2] += w * np.nan_to_num(r)
        weight[v % 2] += w
        number[v % 2] += w > 0
    halves = product / np.maximum(weight, 1e-12)
    both = (weight > 0).all(axis=0)
    size2, error2 = in_common(halves[0][both], halves[1][both], limits)
    if size2 <= 0 or size2 < limits.sigma * error2:
        return PixelOffsets(np.zeros(both.shape), 0.0, np.zeros(both.shape))
    total, n = weight.sum(axis=0), np.maximum(number.sum(axis=0), 1)
    # Noise estimated from neighbours contains the pattern.
    noise2 = np.maximum(n / np.maximum(total, 1e-12) - size2, limits.noise_share * size2) / n
    trust = np.where(total > 0, size2 / (size2 + noise2), 0.0)
    mean = product.sum(axis=0) / np.maximum(total, 1e-12)
    return PixelOffsets(trust * mean, float(np.sqrt(size2)), size2 * (1.0 - trust))


def beside_pixels(views: Sequence[ViewEvidence], offsets: PixelOffsets) -> list[ViewEvidence]:
    """The views with `sigma` less the constant offsets of single pixels, which second differences contain as noise."""
    if offsets.size_m == 0:
        return list(views)
    out = []
    for view in views:
        rest = view.residual - offsets.image / view.frame.length
        out.append(replace(view, sigma=view.noise_of(rest)))
    return out


def in_common(one: Float, other: Float, limits: PatternLimits) -> tuple[float, float]:
    """Covariance in m^2 of the means of two halves of the views over pixels (n,), and its standard error; 0 for too few pixels.

    The halves share the pattern but no noise, so that their covariance is the pattern's variance.
    """
    product = one * other
    if len(product) < limits.pixels:
        return 0.0, 0.0
    product = np.clip(product, *np.quantile(product, [limits.clip, 1.0 - limits.clip]))
    return float(product.mean()), float(product.std() / np.sqrt(len(product)))


def without_pattern(views: Sequence[ViewEvidence], bias: Sequence[Float], unsure2: Float, fit_views: Sequence[int]) -> list[ViewEvidence]:
    """The views with the noise that remains after the pattern's (H, W) `bias` of each is subtracted.

    The error of the pattern's map (variance `unsure2`) adds to the noise of the views that it was not estimated from, and lowers the
    noise of the `fit_views` that it was estimated from.
    """
    out = []
    beside = noise_again([replace(view, residual=view.residual - b) for view, b in zip(views, bias, strict=True)])
    for v, (view, quiet) in enumerate(zip(views, beside, strict=True)):
        seen = quiet.sigma
        wrong2 = (-unsure2 if v in fit_views else unsure2) / view.frame.length**2
        sigma2 = np.maximum(seen**2 - wrong2, view.limits.pattern.level_share * seen**2)
        sigma = np.maximum(np.sqrt(sigma2), view.step_m / np.sqrt(12))
        out.append(replace(view, sigma=sigma, correlation=quiet.correlation))
    return out


def high_pass(view: ViewEvidence) -> Float:
    """(H, W) metres along the ray: residual less its local mean over the smooth pixels; NaN at other pixels."""
    image = view.residual * view.frame.length
    return np.where(view.smooth, image - local_mean(view, view.limits.pattern.window_px), np.nan)


def local_mean(view: ViewEvidence, window_px: int) -> Float:
    """(H, W) metres along the ray: mean residual of the smooth pixels in the window around each pixel; 0 without any."""
    image = np.where(view.smooth, view.residual * view.frame.length, 0.0)
    share = uniform_filter(view.smooth.astype(float), window_px)
    return np.asarray(uniform_filter(image, window_px) / np.maximum(share, 1e-9))
