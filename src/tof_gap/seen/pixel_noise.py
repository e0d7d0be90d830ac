# SPDX-License-Identifier: Apache-2.0
"""Single pixels that are noisier than their neighbours in most views."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import label
from scipy.special import pdtrc

from tof_core.stats import CHI2_MEDIAN, blocks, group_medians, second_differences
from tof_gap.seen.pattern import in_common

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Float, Ints, Mask
    from tof_gap.limits.seen import PixelLimits
    from tof_gap.seen.residual import ViewEvidence

BANDS = 16
"""Bands of rows that are judged one after the other, since the images of all views of a long session take gigabytes."""
ABOVE = 2.0
"""Squared deviation over that of quiet pixels that counts as above the usual: a quarter of quiet pixels in half of the views, nearly all noisy ones."""


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


def noisy_pixels(views: Sequence[ViewEvidence], limits: PixelLimits) -> NoisyPixels:
    """Pixels whose variance over the views exceeds the views' noise; constant offsets of pixels are removed from both."""
    known, variance = _all_rows(views, limits.views)
    quiet = _around(variance, known, limits.around_px)
    where = known & (variance > limits.ratio * np.maximum(quiet, 1e-12))
    share = float(where.sum() / max(known.sum(), 1))
    # A noisy pixel raises the variance of its neighbours in the row, too: only groups of adjacent pixels are independent.
    groups = label(where)[1]
    chance = float(pdtrc(groups - 1, limits.usual * known.sum())) if groups else 1.0
    light2 = float(np.mean([float(np.median(v.sigma[v.smooth] ** 2)) for v in views if v.smooth.any()] or [0.0]))
    size2 = float((variance - quiet)[where].mean()) * light2 if where.any() else 0.0
    return NoisyPixels(where, share, float(np.sqrt(max(size2, 0.0))), chance)


def confirmed(views: Sequence[ViewEvidence], limits: PixelLimits) -> float:
    """Share of the pixels that are noisy in one half of the views and above the usual in the other half, beyond chance.

    A noisy pixel is so in every view. Where light is weak, noise has long tails: other pixels stand out in each half.
    """
    halves = [_all_rows(views[k::2], limits.views // 2) for k in (0, 1)]
    known = halves[0][0] & halves[1][0]
    if not known.any():
        return 0.0
    relative = [variance[known] / max(float(np.median(variance[known])), 1e-12) for _, variance in halves]
    turns = [(here > limits.ratio, there > ABOVE) for here, there in (relative, relative[::-1])]
    both = sum(float((noisy & above).sum()) for noisy, above in turns)
    chance = sum(float(noisy.sum() * above.mean()) for noisy, above in turns)
    flagged = sum(float(noisy.sum()) for noisy, _ in turns)
    return (both - chance) / max(flagged - chance, 1.0)


def _all_rows(views: Sequence[ViewEvidence], least: int) -> tuple[Mask, Float]:
    """(H, W) of `_over_views`, band by band."""
    bands = np.array_split(np.arange(views[0].residual.shape[0]), BANDS)
    known, variance = (np.concatenate(a) for a in zip(*(_over_views(views, rows, least) for rows in bands), strict=True))
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


def _over_views(views: Sequence[ViewEvidence], rows: Ints, least: int) -> tuple[Mask, Float]:
    """(rows, W) pixels that `least` views see, and the variance of each over the views, relative to that of its neighbours."""
    high, sigma = (np.stack(a) for a in zip(*(_against_neighbours(v, rows) for v in views), strict=True))
    seen = np.isfinite(high)
    known = seen.sum(axis=0) >= least
    weight = np.where(seen, sigma**-2, 0.0)
    constant = (weight * np.where(seen, high, 0.0)).sum(axis=0) / np.maximum(weight.sum(axis=0), 1e-12)
    centred = np.where(seen, (high - constant) / sigma, 0.0)
    # The median over the views, so that an edge across a pixel in one view does not make it noisy.
    square = np.where(seen, centred**2, np.nan).reshape(len(views), -1)
    variance = np.zeros(known.shape)
    variance[known] = np.nanmedian(square[:, known.ravel()], axis=0) / CHI2_MEDIAN
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
