# SPDX-License-Identifier: Apache-2.0
"""Pixels beside the steps of a fixed pattern, which a filter in the camera takes for edges."""

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
    """The views with the pixels `stepped` whose neighbourhood the pattern spans with more than noise does, and than in half of the session.

    A filter in the camera compares the depth of neighbours. It sees the pattern there, at the same pixels in every view, whatever
    their light and their part are. A threshold, a part or chance does not know the pattern: what is lost where the pattern is
    smoothest tells of them. Steps within the noise are passed by a filter that passes the noise.

    pattern: (H, W) metres of z of each view.
    """
    spans = [_span(p) for p in pattern]
    counted = np.concatenate([s[expected(v, limits)] for s, v in zip(spans, views, strict=True)])
    half = float(np.median(counted)) if len(counted) else 0.0
    return tuple(replace(v, stepped=(s > half) & (s > _passed(v, limits))) for v, s in zip(views, spans, strict=True))


def _span(pattern: Float) -> Float:
    """(H, W) metres between the farthest and the nearest pixel of each neighbourhood; NaN is no neighbour."""
    most = maximum_filter(np.nan_to_num(pattern, nan=-np.inf), footprint=NEIGHBOURS)
    least = minimum_filter(np.nan_to_num(pattern, nan=np.inf), footprint=NEIGHBOURS)
    return np.asarray(np.where(np.isfinite(most), most - least, 0.0))


def _passed(view: ViewEvidence, limits: MissingLimits) -> Float:
    """(H, W) metres that the noise of one capture spans over a neighbourhood."""
    return np.asarray(limits.filter.noise_sigma * np.sqrt(view.view.captures) * view.sigma)
