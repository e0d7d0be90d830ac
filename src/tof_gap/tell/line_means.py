# SPDX-License-Identifier: Apache-2.0
"""Mean errors of the image's columns and rows over all views: a pattern of lines that no named effect explains.

Means of blocks hide it where neighbouring lines err by opposite amounts.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Float
    from tof_gap.seen.evidence.view import ViewEvidence

LINES = {"column": 0, "row": 1}
"""Lines of the image, and the axis along which their pixels lie."""


def line_sizes_m(views: Sequence[ViewEvidence], left: Sequence[Float], noise2: Sequence[Float]) -> dict[str, float]:
    """RMS in metres of the mean errors of columns, and of rows, above white noise.

    Args:
        views: of one camera.
        left: (H, W) metres of error per view, NaN where it does not count.
        noise2: (H, W) m^2 per view of error that is no bias.
    """
    sums = {name: np.zeros((3, views[0].residual.shape[1 - axis])) for name, axis in LINES.items()}
    for v, e, n2 in zip(views, left, noise2, strict=True):
        known = np.where(np.isfinite(e), 1.0 / n2, 0.0)
        total = known * np.nan_to_num(e)
        for name, axis in LINES.items():
            info = known.sum(axis=axis)
            sums[name] += total.sum(axis=axis), info, v.correlation.area * info
    return {name: _size_m(*of_lines) for name, of_lines in sums.items()}


def _size_m(total: Float, known: Float, white: Float) -> float:
    """RMS of the means of lines (n,) above white noise, from sums of error times information, of information, and of it times its correlation."""
    seen = known > 0
    if not seen.any():
        return 0.0
    mean, variance = total[seen] / known[seen], white[seen] / known[seen] ** 2
    return float(np.sqrt(max(np.average(mean**2 - variance, weights=known[seen]), 0.0)))
