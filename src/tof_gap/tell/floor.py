# SPDX-License-Identifier: Apache-2.0
"""The floor of a residual: noise, and the posterior of the pose, which no model of the sensor can go below."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tof_core.stats import second_differences
from tof_sensor.geometry import pose_columns

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from tof_core.arrays import Float
    from tof_gap.seen.residual import ViewEvidence


def floor2(views: Sequence[ViewEvidence], covs: Float) -> Iterator[Float]:
    """(H, W) m^2 of one view after the other: noise, and the posterior of the pose with the covariances `covs` (V, 6, 6)."""
    for view, cov in zip(views, covs, strict=True):
        J = pose_columns(view.frame)
        yield view.sigma**2 + np.einsum("hwi,ij,hwj->hw", J, cov, J)


def shown2(left: Sequence[Float], noise2: Sequence[Float], known: float) -> list[Float]:
    """(H, W) m^2 per view: the noise that pixels show beside their neighbours in what no effect explains.

    The energy of noise in some thousand pixels differs from its variance, by chance and by what bins of amplitude interpolate; beside a
    gap smaller than the noise, a few percent of that variance are much of the gap's energy. Second differences hold the noise of these
    pixels, and no smooth gap. A rough gap shows in them too: so their sum may differ from that of `noise2` by the share `known` at most.

    Args:
        left: (H, W) metres of each view, NaN where a pixel does not count.
        noise2: (H, W) m^2, the noise's variance.
        known: relative error of its sum, at most.
    """
    seen = [np.isfinite(r) for r in left]
    own = [_beside(r, n) for r, n in zip(left, noise2, strict=True)]
    shown, stated = (sum(float(x[s].sum()) for x, s in zip(every, seen, strict=True)) for every in (own, noise2))
    if not shown > 0.0:
        return list(noise2)
    scale = min(max(shown, (1.0 - known) * stated), (1.0 + known) * stated) / shown
    return [scale * x for x in own]


def _beside(residual: Float, noise2: Float) -> Float:
    """(H, W) m^2: mean square of the second differences along row and column in whose middle a pixel is; `noise2` where there is none."""
    total, count = np.zeros(residual.shape), np.zeros(residual.shape)
    for axis in (0, 1):
        square = second_differences(residual, axis) ** 2
        middle = (slice(1, -1), slice(None)) if axis == 0 else (slice(None), slice(1, -1))
        seen = np.isfinite(square)
        total[middle] += np.where(seen, square, 0.0)
        count[middle] += seen
    return np.where(count > 0, total / np.maximum(count, 1.0), noise2)
