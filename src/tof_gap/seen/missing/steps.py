# SPDX-License-Identifier: Apache-2.0
"""Pixels beside the steps of a fixed pattern, which a filter in the camera takes for edges, or averages over."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import maximum_filter, minimum_filter

from tof_core.stats import second_differences
from tof_gap.seen.missing.lost import NEIGHBOURS, expected, losses_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Float, Mask
    from tof_gap.limits.missing import MissingLimits
    from tof_gap.seen.evidence.view import ViewEvidence

BAND = 12
"""Lines of a band, of which the quietest quarter is compared with all: light and parts change little over them."""
LEAST_LOST = 100.0
"""Lost pixels from which the quarter's loss is known to a tenth."""
AVERAGED = np.ones((5, 5), bool)
"""Largest neighbourhood over which cameras of known firmware average."""


def beside_steps(views: Sequence[ViewEvidence], pattern: Sequence[Float], limits: MissingLimits) -> tuple[ViewEvidence, ...]:
    """The views with `stepped`: pixels around which the pattern varies by more than noise does, and by more than the session's median.

    A filter in the camera compares the depths of neighbours, and reacts to the pattern at the same pixels in every view, at any amplitude
    and on any part. Loss by a threshold, a part or chance does not follow the pattern, and so shows where the pattern is smoothest.
    A filter that passes the noise also passes steps within it. A camera that averages over neighbours after the filter shows steps lower
    than they were: there, whole lines are beside steps if lines around them lose far less.

    pattern: (H, W) metres of z of each view.
    """
    spans = [_span(p) for p in pattern]
    counted = np.concatenate([s[expected(v, limits)] for s, v in zip(spans, views, strict=True)])
    half = float(np.median(counted)) if len(counted) else 0.0
    stepped = [(s > half) & (s > _passed(v, limits)) for v, s in zip(views, spans, strict=True)]
    out = tuple(replace(v, stepped=s) for v, s in zip(views, stepped, strict=True))
    if not views[0].correlation.correlated:
        return out
    lines = _lossy_lines(out, limits)
    # The average takes in neighbours beyond a step or not, from capture to capture: such pixels have a noise of their own.
    out = tuple(replace(v, stepped=s | lines, smooth=v.smooth & ~(s | lines)) for v, s in zip(out, stepped, strict=True))
    noisy = _noise_of_steps(out, [_span(p, AVERAGED) for p in pattern], limits)
    grown = any(n.any() for n in noisy)
    return tuple(replace(v, smooth=v.smooth & ~n, noise_of_steps=grown) for v, n in zip(out, noisy, strict=True))


def _noise_of_steps(views: Sequence[ViewEvidence], spans: Sequence[Float], limits: MissingLimits) -> list[Mask]:
    """(H, W) of each view: pixels that are not in the quarter with the smoothest pattern, if noise grows with what the pattern spans.

    A pixel that an average takes in or not, from capture to capture, changes that average by its share of the pattern's difference.
    The camera's own noise does not follow the pattern, and is read off the quarter.

    spans: (H, W) metres that the pattern spans around each pixel of each view.
    """
    squares = [_relative_square(v) for v in views]
    known = [np.isfinite(s) for s in squares]
    span, square = (np.concatenate([a[k] for a, k in zip(of, known, strict=True)]) for of in (spans, squares))
    if not len(span):
        return [np.zeros_like(k) for k in known]
    low, high = np.quantile(span, [0.25, 0.75])
    grown = np.median(square[span >= high]) > limits.filter.noise_of_steps * np.median(square[span <= low])
    return [s > low if grown else np.zeros(s.shape, bool) for s in spans]


def _relative_square(view: ViewEvidence) -> Float:
    """(H, W) square of the noise of each pixel against its neighbours in the column, relative to the stated variance; NaN where unknown."""
    out = np.full(view.residual.shape, np.nan)
    out[1:-1] = second_differences(np.where(view.smooth, view.residual, np.nan), axis=0) / view.sigma[1:-1]
    return np.asarray(out**2)


def _lossy_lines(views: Sequence[ViewEvidence], limits: MissingLimits) -> Mask:
    """(H, W) pixels of columns, or of rows, of which the quietest quarter of each band of lines loses hardly any pixels; false elsewhere.

    Loss by light, by a part or by chance is alike in next lines. The quarter that loses least remains to be judged.
    """
    shape = views[0].residual.shape
    losses = losses_of(views, limits)
    gone, inside = sum(losses.share), sum(losses.inside)
    for axis in (0, 1):
        of_line, seen = np.sum(gone, axis=axis), np.sum(inside, axis=axis)
        quiet = np.zeros(len(seen), bool)
        for band in np.array_split(np.flatnonzero(seen > 0), max(1, int((seen > 0).sum()) // BAND)):
            rate = of_line[band] / seen[band]
            quiet[band[np.argsort(rate, kind="stable")[: max(1, len(band) // 4)]]] = True
        usual = of_line.sum() / max(seen.sum(), 1.0) * seen[quiet].sum()
        if usual > LEAST_LOST and of_line[quiet].sum() < limits.filter.quiet_lines * usual:
            return np.broadcast_to(np.expand_dims(~quiet, axis), shape)
    return np.zeros(shape, bool)


def _span(pattern: Float, around: Mask = NEIGHBOURS) -> Float:
    """(H, W) metres: largest minus least value of the pattern in the neighbourhood `around` each pixel, without NaN."""
    most = maximum_filter(np.nan_to_num(pattern, nan=-np.inf), footprint=around)
    least = minimum_filter(np.nan_to_num(pattern, nan=np.inf), footprint=around)
    return np.asarray(np.where(np.isfinite(most), most - least, 0.0))


def _passed(view: ViewEvidence, limits: MissingLimits) -> Float:
    """(H, W) metres: range of the noise of one capture over a 3 x 3 neighbourhood."""
    return np.asarray(limits.filter.noise_sigma * np.sqrt(view.view.captures) * view.sigma)
