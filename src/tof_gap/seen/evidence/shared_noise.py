# SPDX-License-Identifier: Apache-2.0
"""The correlation of the noise in the residuals of a session's views."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tof_gap.seen.evidence.correlation import noise_correlation

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_gap.seen.evidence.correlation import NoiseCorrelation
    from tof_gap.seen.evidence.view import ViewEvidence


def correlation_of(views: Sequence[ViewEvidence]) -> NoiseCorrelation:
    """The correlation of the noise in the views' residuals."""
    rounding2 = [_rounding2(v) for v in views if v.smooth.any()]
    of_code = float(np.median(rounding2)) if rounding2 else 0.0
    residuals, masks = [v.residual / v.sigma for v in views], [v.smooth for v in views]
    return noise_correlation(residuals, masks, views[0].limits.correlation, of_code, _between2(views))


def _between2(views: Sequence[ViewEvidence]) -> float:
    """Variance of the mean of a dwell as its captures differ, over that which neighbours show: median of the dwells; 0 without any."""
    ratios = [(v.view.count / v.view.captures * (v.view.sigma / v.sigma) ** 2)[v.smooth] for v in views if v.view.captures > 1]
    over = [np.median(known) for r in ratios if len(known := r[np.isfinite(r)])]
    return float(np.median(over)) if over else 0.0


def _rounding2(view: ViewEvidence) -> float:
    """Variance of a view's depth by the steps of its code, over that of its noise."""
    if view.step_m == 0.0:
        return 0.0
    return view.step_m**2 / 12 / view.view.captures / float(np.median(view.sigma[view.smooth])) ** 2
