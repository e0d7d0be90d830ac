# SPDX-License-Identifier: Apache-2.0
"""The floor of a residual, below which no sensor model can go: noise, and the posterior of the pose."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tof_core.stats import squares
from tof_sensor.geometry import pose_columns

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from tof_core.arrays import Float
    from tof_gap.seen.evidence.view import ViewEvidence


def floor2(views: Sequence[ViewEvidence], covs: Float) -> Iterator[Float]:
    """(H, W) m^2 of one view after the other: noise, and the pose's uncertainty by the covariances `covs` (V, 6, 6)."""
    for view, cov in zip(views, covs, strict=True):
        J = pose_columns(view.frame)
        yield view.sigma**2 + np.einsum("hwi,ij,hwj->hw", J, cov, J)


def shown2(left: Sequence[Float], noise2: Sequence[Float], known: float, side: int, window_px: int = 1) -> list[Float]:
    """(H, W) m^2 per view: the noise of these very pixels, from the error that no effect explains.

    The mean square of noise in some thousand pixels differs from its estimated variance, by chance and since the estimate is
    interpolated between bins of amplitude. Where the gap is smaller than the noise, 1 % of that variance is much of the gap's energy.
    What a pixel does not share with the others of a small square, outside of its row and column, is its noise: also where rows or columns
    have noise of their own, or next neighbours share some. A gap that is constant in a square is shared. Pixels whose neighbours are lost
    are noisier than their amplitude says; they share what all share in the mean. Gross errors are not shared either; therefore the sum of
    the result differs from that of `noise2` by the share `known` at most.

    Args:
        left: (H, W) metres of each view, NaN where a pixel does not count.
        noise2: (H, W) m^2, the noise's variance.
        known: largest relative error of the sum of `noise2`.
        side: of the squares, in pixels.
        window_px: pixels over which a filter in the camera averages; closer ones share noise and are not compared.
    """
    seen = [np.isfinite(r) for r in left]
    shared = [_shared_by(r, side, window_px) for r in left]
    everywhere = float(np.mean(np.concatenate([[0.0], *(x[np.isfinite(x)] for x in shared)])))
    own = [r**2 - np.where(np.isfinite(x), x, everywhere) for r, x in zip(left, shared, strict=True)]
    shown, stated = (sum(float(x[s].sum()) for x, s in zip(every, seen, strict=True)) for every in (own, noise2))
    if not shown > 0.0:
        return list(noise2)
    scale = min(max(shown, (1.0 - known) * stated), (1.0 + known) * stated) / shown
    return [np.where(s, scale * x, n) for x, s, n in zip(own, seen, noise2, strict=True)]


def _shared_by(residual: Float, side: int, window_px: int) -> Float:
    """(H, W) m^2: as `_shared`, of every `window_px`-th pixel with the others of its kind, in squares of at least two by two of them."""
    out = np.empty(residual.shape)
    for start in np.ndindex(window_px, window_px):
        some = tuple(slice(at, None, window_px) for at in start)
        out[some] = _shared(residual[some], max(side // window_px, 2))
    return out


def _shared(residual: Float, side: int) -> Float:
    """(H, W) m^2: product of each pixel with the mean of the pixels of its square in other rows and columns; NaN where there are none.

    The mean over many pixels is the square of what they share; single values may be negative.
    """
    e, n = (squares(x, side) for x in (np.nan_to_num(residual), np.isfinite(residual).astype(float)))

    def others(x: Float) -> Float:
        return np.asarray(x.sum(axis=(1, 3), keepdims=True) - x.sum(axis=3, keepdims=True) - x.sum(axis=1, keepdims=True) + x)

    count = others(n)
    shared = np.where((count > 0) & (n > 0), e * others(e) / np.maximum(count, 1.0), np.nan)
    h, w = residual.shape
    return shared.reshape(shared.shape[0] * side, -1)[:h, :w]
