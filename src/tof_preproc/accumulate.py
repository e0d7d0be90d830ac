# SPDX-License-Identifier: Apache-2.0
"""One depth per pixel from the captures of a dwell: outliers over time are rejected, the others averaged, with a standard error.

Equation 1 of Kim et al. (Appl. Sci. 2024, 14, 4595): the next average is half the last one plus half the new value.
The newest value therefore always has weight 1/2, and the variance never falls below a third of one capture's.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numba import njit

from tof_core.reasons import Reason
from tof_preproc.lanes import IQR_BAND, IQR_TUKEY, SIGMA_PLAIN, SIGMA_ROBUST, bounds, equation_1, moments, quantiles, trim
from tof_preproc.quantum import mean_error2
from tof_preproc.stack import LANES

if TYPE_CHECKING:
    from tof_core.arrays import Bytes, Float, Image, Ints
    from tof_preproc.config import PreprocConfig
    from tof_preproc.stack import Stack

MEAN, MEDIAN, PAPER = 0, 1, 2
METHODS = {"mean": MEAN, "median": MEDIAN, "paper": PAPER}
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
    shape = stack.shape
    *arrays, rejected = _accumulate(
        n,
        stack.ordered,
        stack.count,
        stack.times,
        stack.reasons,
        law.ravel(),
        quantum,
        np.array(codes, np.int64),
        fewest,
        numbers,
        METHODS[config.accumulate.method],
    )
    depth, sigma, noise, count, reason = (a[: shape[0] * shape[1]].reshape(shape) for a in arrays)
    return Accumulated(depth, sigma, noise, count, reason, dict(zip(acting, rejected.tolist(), strict=True)), passed)


def _too_few(n: int, config: PreprocConfig, stages: tuple[str, ...]) -> dict[str, str]:
    need = {"iqr": config.iqr.min_captures, "sigma3": config.sigma3.min_captures}
    return {s: f"{n} of the {need[s]} captures it needs" for s in stages if n < need[s]}


def _code(stage: str, config: PreprocConfig) -> int:
    if stage == "iqr":
        return IQR_BAND if config.iqr.method == "paper" else IQR_TUKEY
    return SIGMA_PLAIN if config.sigma3.method == "paper" else SIGMA_ROBUST


@njit(cache=True, error_model="numpy")
def _accumulate(
    n: int,
    ordered: Image,
    counts: Image,
    times: Image,
    reasons: Bytes,
    law: Image,
    quantum: float,
    codes: Ints,
    fewest: Ints,
    numbers: Float,
    method: int,
) -> tuple[Image, Image, Image, Ints, Bytes, Ints]:
    """Over blocks of pixels; the arrays that `Accumulated` names (blocks times LANES), and per stage the depths it rejected."""
    blocks, pixels = counts.shape[0], law.size
    room = blocks * LANES
    depth, sigma, noise = np.empty(room, np.float32), np.empty(room, np.float32), np.empty(room, np.float32)
    count, reason = np.empty(room, np.uint16), np.zeros(room, np.uint8)
    rejected, expected = np.zeros((codes.size, LANES)), np.ones(LANES, np.float32)
    lo, hi, dropped = np.empty(LANES, np.float32), np.empty(LANES, np.float32), np.zeros((codes.size, LANES), np.float32)
    low, high, value, weight2 = np.empty(LANES), np.empty(LANES), np.empty(LANES), np.empty(LANES)
    for b in range(blocks):
        start = b * LANES
        width = min(LANES, pixels - start)
        s, m, own = ordered[b], counts[b], slice(start, start + LANES)
        for c in range(width):
            expected[c] = law[start + c]
        for c in range(LANES):
            lo[c], hi[c] = np.float32(0.0), m[c]
        for i in range(codes.size):
            bounds(codes[i], s, n, lo, hi, numbers, expected, quantum, fewest[i], low, high)
            trim(s, n, lo, hi, fewest[i], low, high, dropped[i])
            for c in range(LANES):
                rejected[i, c] += dropped[i, c]
        for c in range(width):
            k = hi[c] - lo[c]
            if k == 0 or k < numbers[4] * n:
                reason[start + c] = _why(reasons, n, start + c, codes, dropped[:, c])
                hi[c] = lo[c]
        _values(method, s, n, lo, hi, times[b], value, weight2)
        moments(s, n, lo, hi, low, high)
        if method == MEAN:
            for c in range(LANES):
                value[c] = low[c]
        _variances(high, weight2, lo, hi, m, expected, quantum, codes, method == MEDIAN, low)
        _write(value, high, low, lo, hi, depth[own], noise[own], sigma[own], count[own])
    return depth, sigma, noise, count, reason, rejected.sum(axis=1).astype(np.int64)


@njit(cache=True)
def _why(reasons: Bytes, n: int, p: int, codes: Ints, dropped: Image) -> int:
    """The commonest reason over the captures (N, P) of a pixel, with what each stage over time dropped."""
    votes = np.zeros(REASONS, np.int64)
    for i in range(codes.size):
        votes[IQR_REASON if codes[i] <= IQR_BAND else SIGMA_REASON] += int(dropped[i])
    for i in range(n):
        votes[reasons[i, p]] += 1
    best = 1
    for code in range(2, REASONS):
        if votes[code] > votes[best]:
            best = code
    return best


@njit(cache=True, error_model="numpy")
def _values(method: int, s: Image, n: int, lo: Image, hi: Image, times: Image, value: Float, weight2: Float) -> None:
    """The accumulated value (the mean's is left to the moments) and its variance in units of one capture's."""
    if method == PAPER:
        low, high = np.full(LANES, np.inf), np.full(LANES, -np.inf)
        for c in range(LANES):
            if hi[c] > lo[c]:
                low[c], high[c] = s[int(lo[c]), c], s[int(hi[c]) - 1, c]
        equation_1(times, n, low, high, value, weight2)
        return
    if method == MEDIAN:
        quantiles(s, n, lo, hi, 0.5, value)
    for c in range(LANES):
        k = np.float64(hi[c] - lo[c])
        # Variance of a normal median: pi/2 times the mean's for many, the mean's own for one or two.
        more = 1.0 + (np.pi / 2 - 1) * max(k - 1.0, 0.0) / (k + 0.3)
        weight2[c] = (more if method == MEDIAN else 1.0) / k


@njit(cache=True, error_model="numpy")
def _variances(
    squares: Float,
    weight2: Float,
    lo: Image,
    hi: Image,
    counts: Image,
    law: Image,
    quantum: float,
    codes: Ints,
    on_code: bool,  # noqa: FBT001  (compiled: positional)
    error2: Float,
) -> None:
    """Replace sums of squared deviations by the variance of one capture, and compute the value's squared standard error.

    The variance of one capture is a weighted mean of the pixel's own and that of the law, which counts as `PRIOR_DOF` captures.
    """
    banded, share, price, least = False, 1.0, 1.0, quantum * quantum / 12
    for code in codes:
        banded |= code == IQR_BAND
        if code in (IQR_TUKEY, SIGMA_ROBUST):
            share, price = CUT_SHARE, CUT_PRICE
    for c in range(LANES):
        k, expected = np.float64(hi[c] - lo[c]), np.float64(law[c])
        alone = np.float64(law[c] * law[c])
        trimmed = banded and hi[c] - lo[c] < counts[c]
        own = squares[c] / (BAND_WITHIN if trimmed else share)
        pooled = (PRIOR_DOF * (expected * expected) + own) / (PRIOR_DOF + k - 1)
        variance = alone if k < 2.0 else pooled
        variance = max(least, variance)
        factor = BAND_WITHIN * weight2[c] + BAND_BETWEEN / k if trimmed else weight2[c] * price
        squares[c], error2[c], weight2[c] = variance, variance * factor, factor
    if quantum > 0.0:
        for c in range(LANES):
            if hi[c] > lo[c]:
                error2[c] = mean_error2(squares[c], weight2[c], quantum, on_code)


@njit(cache=True)
def _write(
    value: Float, variance: Float, error2: Float, lo: Image, hi: Image, depth: Image, noise: Image, sigma: Image, count: Ints
) -> None:
    """A block's results; NaN where no capture is left."""
    for c in range(LANES):
        known = hi[c] > lo[c]
        depth[c] = np.float32(value[c]) if known else np.float32(np.nan)
        noise[c] = np.float32(np.sqrt(variance[c])) if known else np.float32(np.nan)
        sigma[c] = np.float32(np.sqrt(error2[c])) if known else np.float32(np.nan)
        count[c] = np.uint16(hi[c] - lo[c])
