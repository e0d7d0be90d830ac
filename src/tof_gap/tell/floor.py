# SPDX-License-Identifier: Apache-2.0
"""The floor of a residual, below which no sensor model can go: noise, and the posterior of the pose."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tof_core.stats import blocks
from tof_sensor.geometry import pose_columns

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from tof_core.arrays import Float
    from tof_gap.seen.residual import ViewEvidence


def floor2(views: Sequence[ViewEvidence], covs: Float) -> Iterator[Float]:
    """(H, W) m^2 of one view after the other: noise, and the pose's uncertainty by the covariances `covs` (V, 6, 6)."""
    for view, cov in zip(views, covs, strict=True):
        J = pose_columns(view.frame)
        yield view.sigma**2 + np.einsum("hwi,ij,hwj->hw", J, cov, J)


def shown2(left: Sequence[Float], noise2: Sequence[Float], known: float, side: int) -> list[Float]:
    """(H, W) m^2 per view: the noise of these very pixels, from the error that no effect explains.

    The mean square of noise in some thousand pixels differs from its estimated variance, by chance and since the estimate is
    interpolated between bins of amplitude. Where the gap is smaller than the noise, 1 % of that variance is much of the gap's energy.
    The variance within small squares contains the noise, also noise that next neighbours share, and no gap that is constant in a square.
    It contains a rough gap too; therefore the sum of the result differs from that of `noise2` by the share `known` at most.

    Args:
        left: (H, W) metres of each view, NaN where a pixel does not count.
        noise2: (H, W) m^2, the noise's variance.
        known: largest relative error of the sum of `noise2`.
        side: of the squares, in pixels.
    """
    seen = [np.isfinite(r) for r in left]
    own = [_within(r, n, side) for r, n in zip(left, noise2, strict=True)]
    shown, stated = (sum(float(x[s].sum()) for x, s in zip(every, seen, strict=True)) for every in (own, noise2))
    if not shown > 0.0:
        return list(noise2)
    scale = min(max(shown, (1.0 - known) * stated), (1.0 + known) * stated) / shown
    return [scale * x for x in own]


def _within(residual: Float, noise2: Float, side: int) -> Float:
    """(H, W) m^2: squared deviation of each pixel from the mean of its square, without bias; `noise2` where a pixel is alone in it."""
    out, seen = noise2.copy(), np.isfinite(residual)
    squares, values = blocks(seen, side), residual[seen]
    others = (squares.count - 1)[squares.which]
    about = (values - squares.mean(values)[squares.which]) ** 2
    out[seen] = np.where(others > 0, about * (others + 1) / np.maximum(others, 1), noise2[seen])
    return out
