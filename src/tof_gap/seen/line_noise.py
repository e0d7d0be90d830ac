# SPDX-License-Identifier: Apache-2.0
"""Scatter that light cannot make: whole rows or columns that jump together, and single pixels that never rest."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tof_gap.seen.pattern import high_pass, in_common

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Float, Mask
    from tof_gap.seen.residual import ViewEvidence

LINE_PIXELS = 20
"""Pixels that a line needs to have a mean."""
SURE = 8.0
"""Standard errors by which lines must scatter more than their pixels allow."""
RESTLESS = 6.0
"""Variance of a pixel over the views, by its median square, against its light's, from which it is restless (one in 2000 quiet pixels of 12 views)."""
PIXEL_SEEN = 8
"""Views that must see a pixel before it can be called restless."""
MIN_SEEN = 5


@dataclass(frozen=True, slots=True, eq=False)
class Lines:
    """Rows (axis 1) or columns (axis 0) that jump together: size in metres along the ray, standard errors above none."""

    axis: int
    size_m: float
    sure: float


def lines(views: Sequence[ViewEvidence], axis: int) -> Lines:
    """Scatter common to the pixels along `axis`, from view to view.

    Second differences across the lines, averaged along them, keep nothing smooth; their mean over the views, a fixed pattern,
    is taken off. White pixels leave them a variance that each line's own pixels tell.
    """
    mean, white = (np.stack(a) for a in zip(*(_line_means(v, axis) for v in views), strict=True))
    seen = np.isfinite(mean)
    views_seen = seen.sum(axis=0)
    seen &= views_seen >= MIN_SEEN
    if not seen.any():
        return Lines(axis, 0.0, 0.0)
    n = np.maximum(views_seen, 2)
    moving = (mean - np.where(seen, mean, 0.0).sum(axis=0) / n) ** 2 * n / (n - 1)
    # A cap keeps one bad line from deciding; it takes 0.2 % of chi-square's mean.
    ratio = np.minimum((moving / white)[seen], 12.0)
    size2 = float(np.median(moving[seen]) / CHI2_MEDIAN - np.median(white[seen])) / 6.0
    return Lines(axis, float(np.sqrt(max(size2, 0.0))), float((ratio - 1).sum() / np.sqrt(2 * len(ratio))))


CHI2_MEDIAN = 0.4549
"""Median of chi-square with one degree of freedom."""


def _line_means(view: ViewEvidence, axis: int) -> tuple[Float, Float]:
    """(L,) mean second difference across each line in metres, and the variance that white pixels would give it."""
    r = np.where(view.smooth, view.residual * view.frame.length, np.nan)
    d2 = np.diff(r, n=2, axis=1 - axis)
    seen = np.isfinite(d2)
    n = seen.sum(axis=axis)
    enough = n >= LINE_PIXELS
    count = np.maximum(n, 1)
    mean = np.where(seen, d2, 0.0).sum(axis=axis) / count
    spread = (np.where(seen, d2, 0.0) ** 2).sum(axis=axis) / count - mean**2
    return np.where(enough, mean, np.nan), np.where(enough, np.maximum(spread, 1e-14) / count, np.nan)


def jumps(view: ViewEvidence, axis: int) -> Float:
    """(H, W) metres of z that the lines of a view have in common, to be taken off before structure is looked for."""
    high = high_pass(view.residual * view.frame.length, view.smooth)
    seen = np.isfinite(high)
    n = seen.sum(axis=axis, keepdims=True)
    mean = np.where(seen, high, 0.0).sum(axis=axis, keepdims=True) / np.maximum(n, 1)
    return np.asarray(np.where(n >= LINE_PIXELS, mean, 0.0) / view.frame.length)


@dataclass(frozen=True, slots=True, eq=False)
class Pixels:
    """Pixels of the raster that scatter more than their light lets them: where, their share, and their size in metres."""

    where: Mask
    share: float
    size_m: float


def restless_pixels(views: Sequence[ViewEvidence], pattern_m: float) -> Pixels:
    """Pixels whose own variance over the views stands out; a constant error of theirs is a pattern and does not count."""
    high, scatter = (np.stack(a) for a in zip(*(_sharp(v) for v in views), strict=True))
    sigma = np.sqrt(np.maximum(scatter**2 - pattern_m**2, 0.1 * scatter**2))  # What neighbours show has the pattern in it.
    seen = np.isfinite(high)
    known = seen.sum(axis=0) >= PIXEL_SEEN
    weight = np.where(seen, sigma**-2, 0.0)
    constant = (weight * np.where(seen, high, 0.0)).sum(axis=0) / np.maximum(weight.sum(axis=0), 1e-12)
    centred = np.where(seen, (high - constant) / sigma, 0.0)
    # The median over the views: an edge that crosses a pixel once makes it no restless one.
    square = np.where(seen, centred**2, np.nan).reshape(len(views), -1)
    variance = np.zeros(known.shape)
    variance[known] = np.nanmedian(square[:, known.ravel()], axis=0) / CHI2_MEDIAN
    quiet = float(np.median(variance[known])) if known.any() else 1.0
    where = known & (variance > RESTLESS * max(quiet, 1e-12))
    share = float(where.sum() / max(known.sum(), 1))
    light2 = float(np.mean([float(np.median(v.sigma[v.smooth] ** 2)) for v in views if v.smooth.any()] or [0.0]))
    size2 = (float(variance[where].mean()) - quiet) * light2 if where.any() else 0.0
    return Pixels(where, share, float(np.sqrt(max(size2, 0.0))))


def pixel_pattern(views: Sequence[ViewEvidence]) -> float:
    """Metres along the ray: RMS of what single pixels err by in every view alike, as second differences along rows see it."""
    d2 = np.stack([np.diff(np.where(v.smooth, v.residual * v.frame.length, np.nan), n=2, axis=1) for v in views]) / np.sqrt(6.0)
    halves, known = [], np.ones(d2.shape[1:], bool)
    for half in (d2[::2], d2[1::2]):
        n = np.isfinite(half).sum(axis=0)
        known &= n >= 2
        halves.append(np.where(np.isfinite(half), half, 0.0).sum(axis=0) / np.maximum(n, 1))
    return float(np.sqrt(max(in_common(halves[0][known], halves[1][known])[0], 0.0)))


def _sharp(view: ViewEvidence) -> tuple[Float, Float]:
    """(H, W) metres along the ray of each pixel against its row's neighbours, and of its scatter."""
    r = np.where(view.smooth, view.residual * view.frame.length, np.nan)
    out = np.full(r.shape, np.nan)
    out[:, 1:-1] = -np.diff(r, n=2, axis=1) / np.sqrt(6.0)
    return out, np.asarray(view.sigma * view.frame.length)
