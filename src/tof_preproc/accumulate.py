# SPDX-License-Identifier: Apache-2.0
"""The captures of a dwell to one depth per pixel: outliers over time rejected, the rest averaged, the error told.

Equation 1 of Kim et al. (Appl. Sci. 2024, 14, 4595): the next average is half the last one plus half the new value.
The newest value therefore weighs 1/2 for ever, and the variance falls to a third of one capture's and no further.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numba import njit

from tof_core.reasons import Reason
from tof_preproc.quantum import mean_error2

if TYPE_CHECKING:
    from tof_core.arrays import Bytes, Image, Ints
    from tof_preproc.config import PreprocConfig

MEAN, MEDIAN, PAPER = 0, 1, 2
METHODS = {"mean": MEAN, "median": MEDIAN, "paper": PAPER}
IQR_TUKEY, IQR_BAND, SIGMA_ROBUST, SIGMA_PLAIN = 0, 1, 2, 3
IQR_REASON, SIGMA_REASON = int(Reason.IQR), int(Reason.THREE_SIGMA)
MAD_TO_SIGMA = 1.4826
PRIOR_DOF = 4.0
"""Weight of the noise law against a pixel's own scatter, in captures: few captures say little about a variance."""
BAND_WITHIN, BAND_BETWEEN = 0.2145, 0.4725
"""Of a normal variance, what is left between its 20 % and 80 % quantiles, and what the band's own place adds.

The variance of the mean of k values kept of such a band is (within + between) / k: a trimmed mean's."""


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


def accumulate(stack: Image, reasons: Bytes, law: Image, quantum: float, config: PreprocConfig, stages: tuple[str, ...]) -> Accumulated:
    """Accumulate captures (N, H, W) with their reasons (N, H, W), oldest first.

    Args:
        stack: depth in metres, NaN where a capture has none.
        reasons: why it has none.
        law: (H, W) expected standard deviation of one capture, metres (`noise.py`).
        quantum: step of the sensor's depth code in metres, 0 where it has none.
        config: numbers of the stages.
        stages: which of `iqr` and `sigma3` act, in this order.
    """
    n = len(stack)
    passed = _too_few(n, config, stages)
    acting = [s for s in stages if s not in passed]
    codes = [_code(s, config) for s in acting]
    numbers = np.array([config.iqr.low, config.iqr.high, config.iqr.fence, config.sigma3.ratio, config.accumulate.min_share])
    fewest = np.array([config.iqr.min_captures if c <= IQR_BAND else config.sigma3.min_captures for c in codes], np.int64)
    depth, sigma, noise, count, reason, rejected = _accumulate(
        stack, reasons, law, quantum, np.array(codes, np.int64), fewest, numbers, METHODS[config.accumulate.method])
    return Accumulated(depth, sigma, noise, count, reason, dict(zip(acting, rejected.tolist(), strict=True)), passed)


def _too_few(n: int, config: PreprocConfig, stages: tuple[str, ...]) -> dict[str, str]:
    need = {"iqr": config.iqr.min_captures, "sigma3": config.sigma3.min_captures}
    return {s: f"{n} of the {need[s]} captures it needs" for s in stages if n < need[s]}


def _code(stage: str, config: PreprocConfig) -> int:
    if stage == "iqr":
        return IQR_BAND if config.iqr.method == "paper" else IQR_TUKEY
    return SIGMA_PLAIN if config.sigma3.method == "paper" else SIGMA_ROBUST


@njit(cache=True)
def _quantile(s: Image, lo: int, hi: int, q: float) -> float:
    """Quantile of sorted s[lo:hi], linear between order statistics (NumPy's default)."""
    at = lo + q * (hi - lo - 1)
    i = int(at)
    return s[i] if i + 1 >= hi else s[i] + (at - i) * (s[i + 1] - s[i])


@njit(cache=True)
def _moments(s: Image, lo: int, hi: int) -> tuple[float, float]:
    """Mean and sum of squared deviations of s[lo:hi]."""
    mean = 0.0
    for i in range(lo, hi):
        mean += s[i]
    mean /= hi - lo
    ss = 0.0
    for i in range(lo, hi):
        ss += (s[i] - mean) ** 2
    return mean, ss


@njit(cache=True)
def _mad(s: Image, lo: int, hi: int, centre: float) -> float:
    """Median of |s - centre| over sorted s[lo:hi]: walk inwards from both ends past the larger half."""
    i, j = lo, hi - 1
    last = before = 0.0
    for _ in range((hi - lo) // 2 + 1):
        before = last
        if centre - s[i] > s[j] - centre:
            last = centre - s[i]
            i += 1
        else:
            last = s[j] - centre
            j -= 1
    return last if (hi - lo) % 2 else 0.5 * (last + before)


@njit(cache=True)
def _bounds(code: int, s: Image, lo: int, hi: int, numbers: Image, law: float, quantum: float) -> tuple[float, float]:
    """Lowest and highest value of sorted s[lo:hi] that a stage keeps."""
    if code <= IQR_BAND:
        q1, q3 = _quantile(s, lo, hi, numbers[0]), _quantile(s, lo, hi, numbers[1])
        # Neighbouring codes of a quantised sensor are one value: without them a mean cannot fall between codes.
        margin = 0.0 if code == IQR_BAND else max(numbers[2] * (q3 - q1), 1.01 * quantum)
        return q1 - margin, q3 + margin
    if code == SIGMA_PLAIN:
        mean, ss = _moments(s, lo, hi)
        reach = numbers[3] * np.sqrt(ss / (hi - lo - 1))
        return mean - reach, mean + reach
    centre = _quantile(s, lo, hi, 0.5)
    reach = max(numbers[3] * max(MAD_TO_SIGMA * _mad(s, lo, hi, centre), law), 1.01 * quantum)
    return centre - reach, centre + reach


@njit(cache=True)
def _equation_1(t: Image, n: int, low: float, high: float) -> tuple[float, float]:
    """The paper's running value over t[:n] within [low, high] in order of time, and the sum of its squared weights."""
    value, weight2 = 0.0, 0.0
    first = True
    for i in range(n):
        if t[i] < low or t[i] > high:
            continue
        if first:
            value, weight2, first = t[i], 1.0, False
        else:
            value, weight2 = 0.5 * (value + t[i]), 0.25 * (weight2 + 1.0)
    return value, weight2


@njit(cache=True)
def _centre(method: int, s: Image, t: Image, n: int, lo: int, hi: int) -> tuple[float, float]:
    """The accumulated value and its variance in units of one capture's."""
    k = hi - lo
    if method == PAPER:
        return _equation_1(t, n, s[lo], s[hi - 1])
    if method == MEDIAN:
        # Variance of a normal median: pi/2 times the mean's for many, the mean's own for one or two.
        return _quantile(s, lo, hi, 0.5), (1.0 + (np.pi / 2 - 1) * max(k - 1.0, 0.0) / (k + 0.3)) / k
    return _moments(s, lo, hi)[0], 1.0 / k


@njit(cache=True)
def _commonest(votes: Ints) -> int:
    best = 1
    for code in range(2, votes.size):
        if votes[code] > votes[best]:
            best = code
    return best


@njit(cache=True, error_model="numpy")
def _accumulate(stack, reasons, law, quantum, codes, fewest, numbers, method):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    n, height, width = stack.shape
    depth = np.full((height, width), np.nan, np.float32)
    sigma, noise = depth.copy(), depth.copy()
    count = np.zeros((height, width), np.uint16)
    reason = np.zeros((height, width), np.uint8)
    rejected = np.zeros(codes.size, np.int64)
    t, s = np.zeros(n), np.zeros(n)
    votes = np.zeros(16, np.int64)
    for v in range(height):
        for u in range(width):
            m = 0
            for i in range(n):
                z = stack[i, v, u]
                if z == z:  # noqa: PLR0124  (not NaN)
                    t[m] = z
                    j = m
                    while j > 0 and s[j - 1] > z:
                        s[j] = s[j - 1]
                        j -= 1
                    s[j] = z
                    m += 1
            lo, hi = 0, m
            votes[:] = 0
            banded = False
            for c in range(codes.size):
                if hi - lo < fewest[c]:
                    continue
                low, high = _bounds(codes[c], s, lo, hi, numbers, law[v, u], quantum)
                before = hi - lo
                while lo < hi - 1 and s[lo] < low:
                    lo += 1
                while hi > lo + 1 and s[hi - 1] > high:
                    hi -= 1
                gone = before - (hi - lo)
                rejected[c] += gone
                votes[IQR_REASON if codes[c] <= IQR_BAND else SIGMA_REASON] += gone
                banded = banded or codes[c] == IQR_BAND
            k = hi - lo
            count[v, u] = k
            if k == 0 or k < numbers[4] * n:
                for i in range(n):
                    votes[reasons[i, v, u]] += reasons[i, v, u] != 0
                reason[v, u] = _commonest(votes)
                count[v, u] = 0
                continue
            value, weight2 = _centre(method, s, t, m, lo, hi)
            own = _moments(s, lo, hi)[1] / (BAND_WITHIN if banded else 1.0)
            prior2 = law[v, u] ** 2
            variance = prior2 if k == 1 else (PRIOR_DOF * prior2 + own) / (PRIOR_DOF + k - 1)
            variance = max(variance, quantum * quantum / 12)
            factor = BAND_WITHIN * weight2 + BAND_BETWEEN / k if banded else weight2
            depth[v, u] = value
            noise[v, u] = np.sqrt(variance)
            sigma[v, u] = np.sqrt(mean_error2(variance, factor, quantum))
    return depth, sigma, noise, count, reason, rejected
