# SPDX-License-Identifier: Apache-2.0
"""The captures of a dwell to one depth per pixel: outliers over time are rejected, the rest averaged, with a standard error.

Equation 1 of Kim et al. (Appl. Sci. 2024, 14, 4595): the next average is half the last one plus half the new value.
The newest value therefore always has weight 1/2, and the variance never falls below a third of one capture's.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numba import njit

from tof_core.reasons import Reason
from tof_core.stats import MAD_TO_STD
from tof_preproc.quantum import mean_error2

if TYPE_CHECKING:
    from tof_core.arrays import Bytes, Float, Image, Ints
    from tof_preproc.config import PreprocConfig
    from tof_preproc.stack import Stack

MEAN, MEDIAN, PAPER = 0, 1, 2
METHODS = {"mean": MEAN, "median": MEDIAN, "paper": PAPER}
IQR_TUKEY, IQR_BAND, SIGMA_ROBUST, SIGMA_PLAIN = 0, 1, 2, 3
IQR_REASON, SIGMA_REASON = int(Reason.IQR), int(Reason.THREE_SIGMA)
REASONS = 16
"""Room for the codes of `Reason`."""
PRIOR_DOF = 8.0
"""Weight of the noise law against a pixel's own variance, in captures, since few captures give a poor estimate of a variance."""
BAND_WITHIN, BAND_BETWEEN = 0.2145, 0.4725
"""Share of a normal variance between the 20 % and 80 % quantiles, and the share that the band's own position adds.

The mean of k values of such a band has the variance (within + between) / k, as a trimmed mean has."""

CUT_SHARE, CUT_PRICE = 0.90, 1.06
"""Share of a normal variance that the fences leave, and factor by which rejecting good values raises the mean's variance (simulated, 3 to 15 captures)."""


@dataclass(frozen=True, slots=True, eq=False)
class Accumulated:
    """Arrays (H, W): depth, its standard error, one capture's noise (metres), captures used, reason."""

    depth: Image
    sigma: Image
    noise: Image
    count: Ints
    reason: Bytes
    rejected: dict[str, int]
    passed: dict[str, str]


def accumulate(stack: Stack, law: Image, quantum: float, config: PreprocConfig, stages: tuple[str, ...]) -> Accumulated:
    """One depth per pixel of the captures of a dwell.

    Args:
        stack: the captures.
        law: (H, W) expected standard deviation of one capture, metres (`noise.py`).
        quantum: step of the sensor's depth code in metres, 0 where it has none.
        config: numbers of the stages.
        stages: which of `iqr` and `sigma3` act, in this order.
    """
    n = stack.captures
    passed = _too_few(n, config, stages)
    acting = [s for s in stages if s not in passed]
    codes = [_code(s, config) for s in acting]
    numbers = np.array([config.iqr.low, config.iqr.high, config.iqr.fence, config.sigma3.ratio, config.accumulate.min_share])
    fewest = np.array([config.iqr.min_captures if c <= IQR_BAND else config.sigma3.min_captures for c in codes], np.int64)
    shape = stack.count.shape
    *arrays, rejected = _accumulate(
        n,
        stack.ordered,
        stack.count.ravel(),
        stack.times,
        stack.reasons,
        law.ravel(),
        quantum,
        np.array(codes, np.int64),
        fewest,
        numbers,
        METHODS[config.accumulate.method],
    )
    depth, sigma, noise, count, reason = (a.reshape(shape) for a in arrays)
    return Accumulated(depth, sigma, noise, count, reason, dict(zip(acting, rejected.tolist(), strict=True)), passed)


def _too_few(n: int, config: PreprocConfig, stages: tuple[str, ...]) -> dict[str, str]:
    need = {"iqr": config.iqr.min_captures, "sigma3": config.sigma3.min_captures}
    return {s: f"{n} of the {need[s]} captures it needs" for s in stages if n < need[s]}


def _code(stage: str, config: PreprocConfig) -> int:
    if stage == "iqr":
        return IQR_BAND if config.iqr.method == "paper" else IQR_TUKEY
    return SIGMA_PLAIN if config.sigma3.method == "paper" else SIGMA_ROBUST


# Below, `s` (P, room) holds the depths of pixel p in ascending order, of which [lo, hi) are still accepted. Rows are
# never sliced: a slice costs more than the sums over it.


@njit(cache=True)
def _quantile(s: Image, p: int, lo: int, hi: int, q: float) -> float:
    """Quantile, linear between order statistics (NumPy's default)."""
    at = lo + q * (hi - lo - 1)
    i = int(at)
    below = np.float64(s[p, i])
    return below if i + 1 >= hi else below + (at - i) * (s[p, i + 1] - below)


@njit(cache=True)
def _moments(s: Image, p: int, lo: int, hi: int) -> tuple[float, float]:
    """Mean and sum of squared deviations."""
    base, total, squares = np.float64(s[p, lo]), 0.0, 0.0
    for i in range(lo + 1, hi):
        step = s[p, i] - base
        total += step
        squares += step * step
    return base + total / (hi - lo), max(squares - total * total / (hi - lo), 0.0)


@njit(cache=True)
def _mad(s: Image, p: int, lo: int, hi: int, centre: float) -> float:
    """Median absolute deviation: walk inwards from both ends past the larger half."""
    i, j = lo, hi - 1
    last = before = 0.0
    for _ in range((hi - lo) // 2 + 1):
        before = last
        left, right = centre - s[p, i], s[p, j] - centre
        if left > right:
            last = left
            i += 1
        else:
            last = right
            j -= 1
    return last if (hi - lo) % 2 else 0.5 * (last + before)


@njit(cache=True, inline="always")
def _bounds(code: int, s: Image, p: int, lo: int, hi: int, numbers: Float, law: float, quantum: float) -> tuple[float, float]:
    """Lowest and highest value that a stage keeps."""
    if code <= IQR_BAND:
        q1, q3 = _quantile(s, p, lo, hi, numbers[0]), _quantile(s, p, lo, hi, numbers[1])
        # Neighbouring codes of a quantised sensor are one value: without them a mean cannot fall between codes.
        margin = 0.0 if code == IQR_BAND else max(numbers[2] * (q3 - q1), 1.01 * quantum)
        return q1 - margin, q3 + margin
    if code == SIGMA_PLAIN:
        mean, squares = _moments(s, p, lo, hi)
        reach = numbers[3] * np.sqrt(squares / (hi - lo - 1))
        return mean - reach, mean + reach
    centre = _quantile(s, p, lo, hi, 0.5)
    reach = max(numbers[3] * max(MAD_TO_STD * _mad(s, p, lo, hi, centre), law), 1.01 * quantum)
    return centre - reach, centre + reach


@njit(cache=True)
def _equation_1(times: Image, n: int, p: int, low: float, high: float) -> tuple[float, float]:
    """The paper's running value over depths (N, P) in order of time within [low, high], and its squared weights' sum."""
    value, weight2 = 0.0, 0.0
    for i in range(n):
        z = times[i, p]
        if low <= z <= high:
            value, weight2 = (0.5 * (value + z), 0.25 * (weight2 + 1.0)) if weight2 > 0 else (np.float64(z), 1.0)
    return value, weight2


@njit(cache=True, inline="always")
def _centre(method: int, mean: float, s: Image, times: Image, n: int, p: int, lo: int, hi: int) -> tuple[float, float]:
    """The accumulated value and its variance in units of one capture's."""
    k = hi - lo
    if method == PAPER:
        value: tuple[float, float] = _equation_1(times, n, p, s[p, lo], s[p, hi - 1])
        return value
    if method == MEDIAN:
        # Variance of a normal median: pi/2 times the mean's for many, the mean's own for one or two.
        return _quantile(s, p, lo, hi, 0.5), (1.0 + (np.pi / 2 - 1) * max(k - 1.0, 0.0) / (k + 0.3)) / k
    return mean, 1.0 / k


@njit(cache=True)
def _variance(own: float, k: int, law: float, quantum: float) -> float:
    """One capture's variance: the pixel's own sum of squares over k captures, drawn towards the law's while k is small."""
    pooled = law * law if k < 2 else (PRIOR_DOF * law * law + own) / (PRIOR_DOF + k - 1)
    return max(pooled, quantum * quantum / 12)


@njit(cache=True)
def _why(reasons: Bytes, n: int, p: int, votes: Ints) -> int:
    """The commonest reason over the captures (N, P); `votes` brings those of the stages over time."""
    for i in range(n):
        votes[reasons[i, p]] += 1
    best = 1
    for code in range(2, votes.size):
        if votes[code] > votes[best]:
            best = code
    return best


@njit(cache=True, inline="always")
def _reject(
    s: Image, p: int, m: int, codes: Ints, fewest: Ints, numbers: Float, law: float, quantum: float, votes: Ints
) -> tuple[int, int]:
    """[lo, hi) that the stages over time leave of m depths, at least one; votes[16 + stage] counts what each rejects."""
    lo, hi = 0, m
    for c in range(codes.size):
        if hi - lo < fewest[c]:
            continue
        low, high = _bounds(codes[c], s, p, lo, hi, numbers, law, quantum)
        before = hi - lo
        while lo < hi - 1 and s[p, lo] < low:
            lo += 1
        while hi > lo + 1 and s[p, hi - 1] > high:
            hi -= 1
        votes[REASONS + c] = before - (hi - lo)
    return lo, hi


@njit(cache=True, error_model="numpy")
def _accumulate(
    n: int,
    s: Image,
    counts: Ints,
    times: Image,
    reasons: Bytes,
    law: Image,
    quantum: float,
    codes: Ints,
    fewest: Ints,
    numbers: Float,
    method: int,
) -> tuple[Image, Image, Image, Ints, Bytes, Ints]:
    """Over pixels (P,); the arrays that `Accumulated` names, and per stage the depths it rejected."""
    pixels = counts.size
    depth = np.full(pixels, np.float32(np.nan))
    sigma, noise = depth.copy(), depth.copy()
    count, reason = np.zeros(pixels, np.uint16), np.zeros(pixels, np.uint8)
    rejected = np.zeros(codes.size, np.int64)
    votes = np.zeros(REASONS + codes.size, np.int64)
    low, high = np.empty(pixels, np.int64), np.empty(pixels, np.int64)
    banded, fenced = np.any(codes == IQR_BAND), np.any((codes == IQR_TUKEY) | (codes == SIGMA_ROBUST))
    for p in range(pixels):
        lo, hi = _reject(s, p, np.int64(counts[p]), codes, fewest, numbers, law[p], quantum, votes)
        k = hi - lo
        low[p], high[p] = lo, hi
        if k == 0 or k < numbers[4] * n:
            votes[:REASONS] = 0
            for c in range(codes.size):
                votes[IQR_REASON if codes[c] <= IQR_BAND else SIGMA_REASON] += votes[REASONS + c]
            reason[p] = _why(reasons, n, p, votes[:REASONS])
            high[p] = lo
        for c in range(codes.size):
            rejected[c] += votes[REASONS + c]
            votes[REASONS + c] = 0
    for p in range(pixels):
        lo, hi = low[p], high[p]
        k = hi - lo
        if k == 0:
            continue
        mean, squares = _moments(s, p, lo, hi)
        value, weight2 = _centre(method, mean, s, times, n, p, lo, hi)
        trimmed = banded and k < np.int64(counts[p])
        own = squares / (BAND_WITHIN if trimmed else (CUT_SHARE if fenced else 1.0))
        variance = _variance(own, k, law[p], quantum)
        factor = BAND_WITHIN * weight2 + BAND_BETWEEN / k if trimmed else weight2 * (CUT_PRICE if fenced else 1.0)
        depth[p], count[p] = value, k
        noise[p], sigma[p] = np.sqrt(variance), np.sqrt(mean_error2(variance, factor, quantum, method == MEDIAN))
    return depth, sigma, noise, count, reason, rejected
