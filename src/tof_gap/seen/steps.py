# SPDX-License-Identifier: Apache-2.0
"""Pixels beside the steps of a fixed pattern, which a filter in the camera mistakes for edges."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import maximum_filter, minimum_filter

from tof_gap.seen.lost import NEIGHBOURS, expected

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Float
    from tof_gap.limits.missing import MissingLimits
    from tof_gap.seen.residual import ViewEvidence


def beside_steps(views: Sequence[ViewEvidence], pattern: Sequence[Float], limits: MissingLimits) -> tuple[ViewEvidence, ...]:
    """The views with `stepped`: pixels around which the pattern varies by more than noise does, and by more than the session's median.

    A filter in the camera compares the depths of neighbours, and reacts to the pattern at the same pixels in every view, at any amplitude
    and on any part. Loss by a threshold, a part or chance does not follow the pattern, and so shows where the pattern is smoothest.
    A filter that passes the noise also passes steps within it.

    pattern: (H, W) metres of z of each view.
    """
    spans = [_span(p) for p in pattern]
    counted = np.concatenate([s[expected(v, limits)] for s, v in zip(spans, views, strict=True)])
    half = float(np.median(counted)) if len(counted) else 0.0
    return tuple(replace(v, stepped=(s > half) & (s > _passed(v, limits))) for v, s in zip(views, spans, strict=True))


def _span(pattern: Float) -> Float:
    """(H, W) metres: largest minus least value of the pattern in each 3 x 3 neighbourhood, without NaN."""
    most = maximum_filter(np.nan_to_num(pattern, nan=-np.inf), footprint=NEIGHBOURS)
    least = minimum_filter(np.nan_to_num(pattern, nan=np.inf), footprint=NEIGHBOURS)
    return np.asarray(np.where(np.isfinite(most), most - least, 0.0))


def _passed(view: ViewEvidence, limits: MissingLimits) -> Float:
    """(H, W) metres: range of the noise of one capture over a 3 x 3 neighbourhood."""
    return np.asarray(limits.filter.noise_sigma * np.sqrt(view.view.captures) * view.sigma)
