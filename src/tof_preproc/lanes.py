# SPDX-License-Identifier: Apache-2.0
"""Order statistics over time of the pixels of a block, all `LANES` of them side by side.

`s` (N, LANES) holds each pixel's depths in ascending order; those with index in [lo, hi) count. Every loop runs over the
pixels of one row without a branch, so that the compiler works on eight or sixteen pixels with one instruction.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numba import njit

from tof_core.stats import MAD_TO_STD
from tof_preproc.stack import LANES

if TYPE_CHECKING:
    from tof_core.arrays import Float, Image, Mask

IQR_TUKEY, IQR_BAND, SIGMA_ROBUST, SIGMA_PLAIN = 0, 1, 2, 3
ONE = np.float32(1.0)


@njit(cache=True, error_model="numpy")
def quantiles(s: Image, n: int, lo: Image, hi: Image, q: float, out: Float) -> None:
    """Quantile of each pixel, linear between order statistics (NumPy's default)."""
    at, below, above = np.empty(LANES, np.float32), np.empty(LANES, np.float32), np.empty(LANES, np.float32)
    for c in range(LANES):
        at[c] = np.float32(np.floor(lo[c] + q * (np.float64(hi[c] - lo[c]) - 1.0)))
        below[c] = above[c] = s[0, c]
    for j in range(1, n):
        i = np.float32(j)
        for c in range(LANES):
            z, first = s[j, c], at[c]
            below[c] = z if first >= i else below[c]
            above[c] = z if first + ONE >= i else above[c]
    for c in range(LANES):
        value = np.float64(below[c])
        part = lo[c] + q * (np.float64(hi[c] - lo[c]) - 1.0) - at[c]
        step = part * (np.float64(above[c]) - value)
        out[c] = value + (step if at[c] + ONE < hi[c] else 0.0)


@njit(cache=True, error_model="numpy")
def moments(s: Image, n: int, lo: Image, hi: Image, mean: Float, squares: Float) -> None:
    """Mean and sum of squared deviations of each pixel."""
    base, total = np.empty(LANES), np.zeros(LANES)
    for c in range(LANES):
        base[c], squares[c] = np.float64(s[0, c]), 0.0
    for j in range(1, n):
        i = np.float32(j)
        for c in range(LANES):
            base[c] = np.float64(s[j, c]) if lo[c] >= i else base[c]
    for j in range(1, n):
        i = np.float32(j)
        for c in range(LANES):
            inside = (lo[c] < i) & (i < hi[c])
            step = (np.float64(s[j, c]) if inside else base[c]) - base[c]
            total[c] += step
            squares[c] += step * step
    for c in range(LANES):
        k = np.float64(hi[c] - lo[c])
        mean[c] = base[c] + total[c] / k
        rest = squares[c] - total[c] * total[c] / k
        squares[c] = max(0.0, rest)


@njit(cache=True, error_model="numpy")
def trim(s: Image, n: int, lo: Image, hi: Image, fewest: int, low: Float, high: Float, rejected: Image) -> None:
    """Move [lo, hi) within the bounds where at least `fewest` depths are left, but leave one; `rejected` per pixel."""
    below, upto, least = np.zeros(LANES, np.float32), np.zeros(LANES, np.float32), np.float32(fewest)
    for j in range(n):
        for c in range(LANES):
            z = np.float64(s[j, c])
            below[c] += ONE if z < low[c] else np.float32(0.0)
            upto[c] += ONE if z <= high[c] else np.float32(0.0)
    for c in range(LANES):
        first, last = lo[c], hi[c]
        acts = last - first >= least
        new_first = max(first, min(below[c], last - ONE))
        new_last = max(min(last, upto[c]), new_first + ONE)
        rejected[c] = (last - first) - (new_last - new_first) if acts else np.float32(0.0)
        lo[c] = new_first if acts else first
        hi[c] = new_last if acts else last


@njit(cache=True, error_model="numpy")
def bounds(
    code: int, s: Image, n: int, lo: Image, hi: Image, numbers: Float, law: Image, quantum: float, fewest: int, low: Float, high: Float
) -> None:
    """Lowest and highest value that a stage keeps, of pixels with at least `fewest` depths."""
    if code <= IQR_BAND:
        quantiles(s, n, lo, hi, numbers[0], low)
        quantiles(s, n, lo, hi, numbers[1], high)
        if code == IQR_TUKEY:
            # Neighbouring codes of a quantised sensor are one value: without them a mean cannot fall between codes.
            for c in range(LANES):
                margin = max(numbers[2] * (high[c] - low[c]), 1.01 * quantum)
                low[c], high[c] = low[c] - margin, high[c] + margin
    elif code == SIGMA_PLAIN:
        moments(s, n, lo, hi, low, high)
        for c in range(LANES):
            mean, reach = low[c], numbers[3] * np.sqrt(high[c] / (hi[c] - lo[c] - 1))
            low[c], high[c] = mean - reach, mean + reach
    else:
        centre = np.empty(LANES)
        quantiles(s, n, lo, hi, 0.5, centre)
        for c in range(LANES):
            reach = max(numbers[3] * law[c], 1.01 * quantum)
            low[c], high[c] = centre[c] - reach, centre[c] + reach
        # The deviation is at least the expected noise, so the MAD is needed only for pixels with depths beyond that.
        beyond = _beyond(s, n, lo, hi, low, high, np.float32(fewest))
        for c in range(LANES):
            if beyond[c]:
                first, last = int(lo[c]), int(hi[c])
                reach = max(numbers[3] * max(MAD_TO_STD * _mad(s, c, first, last, centre[c]), law[c]), 1.01 * quantum)
                low[c], high[c] = centre[c] - reach, centre[c] + reach


@njit(cache=True, error_model="numpy")
def _beyond(s: Image, n: int, lo: Image, hi: Image, low: Float, high: Float, fewest: np.float32) -> Mask:
    """Whether a pixel has at least `fewest` depths and its least is below `low` or its largest above `high`."""
    least, largest, out = s[0].copy(), s[0].copy(), np.empty(LANES, np.bool_)
    for j in range(1, n):
        i = np.float32(j)
        for c in range(LANES):
            z = s[j, c]
            least[c] = z if lo[c] >= i else least[c]
            largest[c] = z if hi[c] > i else largest[c]
    for c in range(LANES):
        out[c] = (hi[c] - lo[c] >= fewest) & ((least[c] < low[c]) | (largest[c] > high[c]))
    return out


@njit(cache=True)
def _mad(s: Image, c: int, lo: int, hi: int, centre: float) -> float:
    """Median absolute deviation of a pixel: walk inwards from both ends past the larger half."""
    i, j = lo, hi - 1
    last = before = 0.0
    for _ in range((hi - lo) // 2 + 1):
        before = last
        left, right = centre - s[i, c], s[j, c] - centre
        if left > right:
            last = left
            i += 1
        else:
            last = right
            j -= 1
    return last if (hi - lo) % 2 else 0.5 * (last + before)


@njit(cache=True, error_model="numpy")
def equation_1(times: Image, n: int, low: Float, high: Float, value: Float, weight2: Float) -> None:
    """The paper's running value over depths (N, LANES) in order of time within [low, high], and its squared weights' sum."""
    value[:], weight2[:] = 0.0, 0.0
    for i in range(n):
        for c in range(LANES):
            z, last, weight = np.float64(times[i, c]), value[c], weight2[c]
            inside, begun = (low[c] <= z) & (z <= high[c]), weight > 0.0
            new = 0.5 * (last + z) if begun else z
            new_weight = 0.25 * (weight + 1.0) if begun else 1.0
            value[c] = new if inside else last
            weight2[c] = new_weight if inside else weight
