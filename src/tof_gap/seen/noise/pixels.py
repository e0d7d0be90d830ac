# SPDX-License-Identifier: Apache-2.0
"""Single pixels that are noisier than their neighbours in most views."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import label, uniform_filter
from scipy.special import pdtrc

from tof_core.stats import CHI2_MEDIAN, blocks, group_medians, second_differences
from tof_gap.seen.evidence.pattern import in_common

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from tof_core.arrays import Float, Ints, Mask
    from tof_gap.limits.noise import PixelLimits
    from tof_gap.seen.evidence.view import ViewEvidence

BANDS = 16
"""Bands of rows that are judged one after the other, since the images of all views of a long session take gigabytes."""
SIDE = 3
"""Side in pixels of the squares over which variances are averaged: that of the smallest average of a camera."""
KEPT = 0.95
"""Quantile of the squared deviations of a view up to which they count."""
OF_KEPT = 0.759
"""Mean square of normal deviations up to that quantile, over their variance."""
CAP2 = 16.0
"""Squared deviation, in variances, beyond which one counts no more: four standard deviations are an edge."""

INTERPOLATED = 3.5
"""Variance of a pixel, over that of the pixels around, up to which a driver that interpolates explains it.

By bilinear weights the second differences of white noise have 1.5 times its variance on one of the sensor's pixels, and 0.35 times in the
median: 4.3 times as much at most. Over all pixels that stand out: 1.9 to 2.7 in six such sessions; 4.8 to 30 of unstable pixels in five.
"""


@dataclass(frozen=True, slots=True, eq=False)
class NoisyPixels:
    """Pixels with a noise of their own.

    where: (H, W) pixels noisier than their amplitude predicts; share: of the pixels seen; size_m: their own noise, metres along the
    ray; chance: probability that as many of as many quiet pixels stand out.
    """

    where: Mask
    share: float
    size_m: float
    chance: float

    @property
    def rms_m(self) -> float:
        """Metres along the ray: RMS of that noise over the image."""
        return float(self.size_m * np.sqrt(self.share))


def noisy_pixels(views: Sequence[ViewEvidence], limits: PixelLimits) -> NoisyPixels:
    """Pixels whose variance over the views exceeds the views' noise; constant offsets of pixels are removed from both."""
    known, variance = _all_rows(views, limits.views, _median)
    quiet = _around(variance, known, limits.around_px)
    where = known & (variance > limits.ratio * np.maximum(quiet, 1e-12))
    share = float(where.sum() / max(known.sum(), 1))
    # A noisy pixel raises the variance of its neighbours in the row, too: only groups of adjacent pixels are independent.
    groups = label(where)[1]
    chance = float(pdtrc(groups - 1, limits.usual * known.sum())) if groups else 1.0
    light2 = float(np.mean([float(np.median(v.sigma[v.smooth] ** 2)) for v in views if v.smooth.any()] or [0.0]))
    size2 = float((variance - quiet)[where].mean()) * light2 if where.any() else 0.0
    return NoisyPixels(where, share, float(np.sqrt(max(size2, 0.0))), chance)


def noise_by_view(views: Sequence[ViewEvidence], where: Mask) -> Float:
    """(V,) noise of the pixels `where` (H, W) beyond that of their views, in each, up to one common factor; 0 where a view shows none.

    The largest deviations are left out, as edges and textures make them in single views. The factor is 0.8 metres along the ray a metre
    for noise of single pixels, whose neighbours are quiet.
    """
    out = np.zeros(len(views))
    rows = np.arange(where.shape[0])
    for i, view in enumerate(views):
        high, sigma = _against_neighbours(view, rows)
        seen = where & np.isfinite(high)
        if seen.any():
            square = high[seen] ** 2
            kept = square <= np.quantile(square, KEPT)
            out[i] = np.sqrt(max(float(square[kept].mean() / OF_KEPT - (sigma[seen][kept] ** 2).mean()), 0.0))
    return out


def halves_agree(views: Sequence[ViewEvidence], limits: PixelLimits) -> float:
    """How noisy those pixels are in the other half of the views that are noisiest in one half.

    The result is their mean ln variance above that of all pixels, in its standard deviations. An unstable pixel is noisy in every view. Long tails of noise in weak light, edges and texture make other pixels noisy in each half: 0.
    """
    halves = [_ln_variance(views[k::2], limits) for k in (0, 1)]
    seen = np.isfinite(halves[0]) & np.isfinite(halves[1])
    if seen.sum() < limits.least_pixels:
        return 0.0
    scaled = [(h[seen] - h[seen].mean()) / max(float(h[seen].std()), 1e-12) for h in halves]
    noisiest = [h > np.quantile(h, 1.0 - limits.noisiest) for h in scaled]
    return float(np.mean([there[here].mean() for here, there in zip(noisiest, scaled[::-1], strict=True)]))


def variance_elsewhere(views: Sequence[ViewEvidence], limits: PixelLimits) -> float:
    """Mean variance, over that of the pixels around, in the other half of the views of the pixels that are noisy in one half; 1 without any.

    The noisiest of many pixels are so in part by chance: how noisy they are is seen where they were not chosen.
    """
    least = limits.views // 2
    halves = [[_over_those_around(views[k::2], least, limits.around_px, of) for of in (_median, _capped_mean)] for k in (0, 1)]
    noisy = [np.isfinite(chosen) & (chosen > limits.ratio) for chosen, _ in halves]
    found = np.concatenate([judged[where & np.isfinite(judged)] for where, (_, judged) in zip(noisy, halves[::-1], strict=True)])
    return float(found.mean()) if len(found) else 1.0


def _over_those_around(views: Sequence[ViewEvidence], least: int, side: int, of: Callable[[Float], Float]) -> Float:
    """(H, W) variance `of` each pixel over that of the pixels around; NaN where fewer than `least` views see it."""
    known, variance = _all_rows(views, least, of)
    return np.where(known, variance / np.maximum(_around(variance, known, side), 1e-12), np.nan)


def _ln_variance(views: Sequence[ViewEvidence], limits: PixelLimits) -> Float:
    """(H, W) ln of the mean variance over `SIDE` x `SIDE` pixels, over that of the region and of the line.

    NaN where too few pixels are seen, and on lines that are noisier or quieter as a whole. A camera that averages spreads the noise of a pixel over its neighbours. Beside the steps of a pattern of lines, such an average takes
    in neighbours by chance: whole lines are noisy then, not pixels.
    """
    ratio = _over_those_around(views, limits.views // 2, limits.around_px, _capped_mean)
    known = np.isfinite(ratio)
    share = uniform_filter(known.astype(float), SIDE, mode="constant")
    mean = uniform_filter(np.where(known, ratio, 0.0), SIDE, mode="constant")
    enough = known & (share > 0.5)
    out = np.full(known.shape, np.nan)
    out[enough] = np.log(np.maximum(mean[enough] / share[enough], 1e-12))
    for axis, lines in enumerate(known.shape):
        seen = np.isfinite(out)
        which = np.nonzero(seen)[axis]
        of_line = group_medians(out[seen], which, lines)[which]
        out[seen] = np.where(np.abs(of_line) < limits.line, out[seen] - of_line, np.nan)
    return out


def _all_rows(views: Sequence[ViewEvidence], least: int, of: Callable[[Float], Float]) -> tuple[Mask, Float]:
    """(H, W) of `_over_views`, band by band."""
    bands = np.array_split(np.arange(views[0].residual.shape[0]), BANDS)
    known, variance = (np.concatenate(a) for a in zip(*(_over_views(views, rows, least, of) for rows in bands), strict=True))
    return known, variance


def _around(variance: Float, known: Mask, side: int) -> Float:
    """(H, W) median variance of the pixels in squares of `side`, at least that of all pixels; in squares with few pixels that of all.

    Where the photon law is too low for the light of a whole region, no pixel is noisier than those around it.
    """
    if not known.any():
        return np.ones(variance.shape)
    groups = blocks(known, side)
    of_square = group_medians(variance[known], groups.which, len(groups.count), least=side * side // 2)
    out = np.full(variance.shape, float(np.median(variance[known])))
    out[known] = np.maximum(out[known], of_square[groups.which])
    return out


def _median(squares: Float) -> Float:
    """(n,) variance from squared deviations (V, n), NaN where unseen: an edge across a pixel in one view does not make it noisy."""
    return np.asarray(np.nanmedian(squares, axis=0) / CHI2_MEDIAN)


def _capped_mean(squares: Float) -> Float:
    """(n,) mean of squared deviations (V, n), NaN where unseen, of which the largest count as `CAP2`: more exact than the median."""
    return np.asarray(np.nanmean(np.minimum(squares, CAP2), axis=0))


def _over_views(views: Sequence[ViewEvidence], rows: Ints, least: int, of: Callable[[Float], Float]) -> tuple[Mask, Float]:
    """(rows, W) pixels that `least` views see, and the variance `of` each over the views, relative to that of its neighbours."""
    high, sigma = (np.stack(a) for a in zip(*(_against_neighbours(v, rows) for v in views), strict=True))
    seen = np.isfinite(high)
    known = seen.sum(axis=0) >= least
    weight = np.where(seen, sigma**-2, 0.0)
    constant = (weight * np.where(seen, high, 0.0)).sum(axis=0) / np.maximum(weight.sum(axis=0), 1e-12)
    centred = np.where(seen, (high - constant) / sigma, 0.0)
    square = np.where(seen, centred**2, np.nan).reshape(len(views), -1)
    variance = np.zeros(known.shape)
    variance[known] = of(square[:, known.ravel()])
    return known, variance


def pixel_pattern(views: Sequence[ViewEvidence]) -> float:
    """Metres along the ray: RMS offset of single pixels that all views share, from second differences along rows.

    A filter in the camera averages offsets as it averages noise: neighbours share them alike.
    """
    of = views[0].correlation
    return float(np.sqrt(of.variance([_in_common(views, step) for step in of.steps])))


def _in_common(views: Sequence[ViewEvidence], step: int) -> float:
    """m^2: variance of the second differences of pixels `step` apart along rows that both halves of the views share."""
    height, width = views[0].residual.shape
    total, number = np.zeros((2, 2, height, width - 2 * step))
    for v, view in enumerate(views):
        d2 = second_differences(np.where(view.smooth, view.residual * view.frame.length, np.nan), axis=1, step=step)
        total[v % 2] += np.where(np.isfinite(d2), d2, 0.0)
        number[v % 2] += np.isfinite(d2)
    halves, known = total / np.maximum(number, 1), (number >= 2).all(axis=0)
    return max(in_common(halves[0][known], halves[1][known], views[0].limits.pattern)[0], 0.0)


def _against_neighbours(view: ViewEvidence, rows: Ints) -> tuple[Float, Float]:
    """(rows, W) metres along the ray: each pixel less the mean of its two neighbours in the row, scaled to its own noise; and that noise."""
    length = view.frame.length[rows]
    r = np.where(view.smooth[rows], view.residual[rows] * length, np.nan)
    out = np.full(r.shape, np.nan)
    out[:, 1:-1] = -second_differences(r, axis=1)
    return out, np.asarray(view.sigma[rows] * length)
