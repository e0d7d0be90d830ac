# SPDX-License-Identifier: Apache-2.0
"""Noise of whole rows or columns, which change together from view to view; photon noise does not."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tof_core.stats import CHI2_MEDIAN, second_differences
from tof_gap.seen.evidence.pattern import high_pass

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Float
    from tof_gap.limits.noise import LineLimits
    from tof_gap.seen.evidence.view import ViewEvidence


QUARTERS = 4
"""Parts of a line that are compared with each other."""
APART = (0, 2), (0, 3), (1, 3)
"""Those that are not adjacent."""


@dataclass(frozen=True, slots=True, eq=False)
class LineNoise:
    """Noise that whole rows (axis 1) or columns (axis 0) share.

    size_m: standard deviation in metres along the ray; sigma: its significance, the excess over white noise in standard errors.
    """

    axis: int
    size_m: float
    sigma: float


def line_noise(views: Sequence[ViewEvidence], axis: int, limits: LineLimits) -> LineNoise:
    """Noise that the pixels along `axis` share, from view to view.

    Second differences across the lines, averaged along each line, contain no smooth error. Their mean over the views, a fixed
    pattern, is subtracted. Their variance by white noise is known from the pixels of each line. A filter in the camera averages lines as
    it averages pixels: then lines two apart are compared as well (`NoiseCorrelation.variance`).
    """
    of = views[0].correlation
    found = [_in_common(views, axis, limits, step) for step in of.steps]
    size2 = of.variance([size2 for size2, _ in found])
    return LineNoise(axis, float(np.sqrt(max(size2, 0.0))), max(sigma for _, sigma in found))


def shared_m(views: Sequence[ViewEvidence], axis: int, limits: LineLimits) -> float:
    """Standard deviation in metres along the ray that quarters of a line along `axis` have in common which are not adjacent.

    Errors of a surface, such as the rim of an object, are in one place of a line. Noise of the read-out is in all of it; it may change its
    sign with the phase, so that quarters share less than all.
    """
    of = views[0].correlation
    return float(np.sqrt(max(of.variance([_shared2(views, axis, limits, step) for step in of.steps]), 0.0)))


def everywhere_m(views: Sequence[ViewEvidence], axis: int, limits: LineLimits) -> float:
    """Standard deviation in metres along the ray that lines along `axis` have in most of their quarters, whatever its sign in each.

    Read-out noise of a line turns the phase by an amount that changes its sign with the phase, that is, with range: quarters then share none
    of it, and each has some. Of four quarters the second least counts: an error of a surface is in one place of a line.
    """
    of = views[0].correlation
    return float(np.sqrt(max(of.variance([_everywhere2(views, axis, limits, step) for step in of.steps]), 0.0)))


def line_noise_by_view(views: Sequence[ViewEvidence], axis: int, limits: LineLimits) -> Float:
    """(V,) standard deviation in metres along the ray of the noise that the pixels along `axis` share in each view.

    Noise of lines grows in weak light, so views of one session differ. Lines are compared that share no noise through a filter in the camera.
    """
    of = views[0].correlation
    change2, white = _changes(views, axis, limits, of.window_px + 1 if of.correlated else 1)
    return np.array([np.sqrt(max(_beyond(c, w), 0.0)) for c, w in zip(change2, white, strict=True)])


def _in_common(views: Sequence[ViewEvidence], axis: int, limits: LineLimits, step: int) -> tuple[float, float]:
    """Variance in m^2 that differences of lines `step` apart show, less that by white noise, and its significance."""
    change2, white = _changes(views, axis, limits, step)
    seen = np.isfinite(change2)
    if seen.any(axis=0).sum() < limits.lines:
        return 0.0, 0.0
    ratio = np.minimum((change2 / white)[seen], limits.most_ratio)
    return _beyond(change2, white), float((ratio - 1).sum() / np.sqrt(2 * len(ratio)))


def _shared2(views: Sequence[ViewEvidence], axis: int, limits: LineLimits, step: int) -> float:
    """m^2: covariance, over views and lines, of the mean second differences of quarters of a line that are not adjacent."""
    off = _quarters_off(views, axis, limits, step)
    seen = np.isfinite(off)
    cap2 = limits.most_ratio * float(np.median(off[seen] ** 2)) / CHI2_MEDIAN if seen.any() else 0.0
    products = np.concatenate([(off[:, one] * off[:, other]).ravel() for one, other in APART])
    known = products[np.isfinite(products)]
    return float(np.clip(known, -cap2, cap2).mean()) if len(known) else 0.0


def _everywhere2(views: Sequence[ViewEvidence], axis: int, limits: LineLimits, step: int) -> float:
    """m^2: usual square, over views and lines, of the mean second difference of the second least quarter, less that of white noise."""
    off = _quarters_off(views, axis, limits, step)
    white = QUARTERS * np.stack([_line_means(v, axis, limits, step)[1] for v in views])
    second = np.sort(np.where(np.isfinite(off), np.square(off), np.inf), axis=1)[:, 1]
    seen = np.isfinite(white) & (np.isfinite(off).sum(axis=1) >= QUARTERS - 1)
    return float(np.median(second[seen]) / CHI2_MEDIAN - np.median(white[seen])) if seen.any() else 0.0


def _quarters_off(views: Sequence[ViewEvidence], axis: int, limits: LineLimits, step: int) -> Float:
    """(V, 4, L) mean second difference of each quarter of a line, less that of all views."""
    return _beside_mean(np.stack([_quarter_means(v, axis, limits, step) for v in views]), limits)[0]


def _quarter_means(view: ViewEvidence, axis: int, limits: LineLimits, step: int) -> Float:
    """(4, L) mean second difference across lines `step` apart, of each quarter of a line; NaN where it has too few pixels."""
    d2 = _across(view, axis, step)
    quarters = np.array_split(d2, QUARTERS, axis=axis)
    count = np.stack([np.isfinite(q).sum(axis=axis) for q in quarters])
    total = np.stack([np.where(np.isfinite(q), q, 0.0).sum(axis=axis) for q in quarters])
    return np.where(count >= limits.pixels // 2, total / np.maximum(count, 1), np.nan)


def _changes(views: Sequence[ViewEvidence], axis: int, limits: LineLimits, step: int) -> tuple[Float, Float]:
    """(V, L) m^2: squared deviation of the mean second difference across lines from that of all views, and its variance by white noise.

    NaN where too few views see the line.
    """
    mean, white = (np.stack(a) for a in zip(*(_line_means(v, axis, limits, step) for v in views), strict=True))
    off, n = _beside_mean(mean, limits)
    seen = np.isfinite(off)
    return off**2 * n / (n - 1), np.where(seen, white, np.nan)


def _beside_mean(mean: Float, limits: LineLimits) -> tuple[Float, Float]:
    """(V, ...) less the mean over the views (V), a fixed pattern, NaN where too few see the line; and (...) number of these views, at least 2."""
    seen = np.isfinite(mean)
    views_seen = seen.sum(axis=0)
    seen &= views_seen >= limits.views
    n = np.maximum(views_seen, 2)
    return np.where(seen, mean - np.where(seen, mean, 0.0).sum(axis=0) / n, np.nan), n


def _across(view: ViewEvidence, axis: int, step: int) -> Float:
    """(H, W) second differences across lines along `axis` that are `step` apart, metres along the ray; NaN at pixels that are not smooth."""
    return second_differences(np.where(view.smooth, view.residual * view.frame.length, np.nan), 1 - axis, step)


def _beyond(change2: Float, white: Float) -> float:
    """m^2: usual variance of the changes above that by white noise; 0 where none is known."""
    seen = np.isfinite(change2)
    return float(np.median(change2[seen]) / CHI2_MEDIAN - np.median(white[seen])) if seen.any() else 0.0


def _line_means(view: ViewEvidence, axis: int, limits: LineLimits, step: int) -> tuple[Float, Float]:
    """(L,) mean second difference across lines `step` apart, in metres of one line's noise, and its variance by white noise."""
    d2 = _across(view, axis, step)
    seen = np.isfinite(d2)
    n = seen.sum(axis=axis)
    enough = n >= limits.pixels
    count = np.maximum(n, 1)
    mean = np.where(seen, d2, 0.0).sum(axis=axis) / count
    spread = (np.where(seen, d2, 0.0) ** 2).sum(axis=axis) / count - mean**2
    return np.where(enough, mean, np.nan), np.where(enough, view.correlation.line * np.maximum(spread, 1e-14) / count, np.nan)


def line_map(view: ViewEvidence, axis: int, limits: LineLimits) -> Float:
    """(H, W) metres of z: mean of the high-passed residual along each line of a view, 0 where a line has too few pixels."""
    high = high_pass(view)
    seen = np.isfinite(high)
    n = seen.sum(axis=axis, keepdims=True)
    mean = np.where(seen, high, 0.0).sum(axis=axis, keepdims=True) / np.maximum(n, 1)
    return np.asarray(np.where(n >= limits.pixels, mean, 0.0) / view.frame.length)
