# SPDX-License-Identifier: Apache-2.0
"""Noise of one capture: a photon law of amplitude, fitted to the captures themselves.

At the amplitude A, depth has the variance a0 + a1 / A + a2 / A^2. The terms are quantisation, photon noise of the
camera's own light, and photon noise of ambient light with the noise of the circuit (docs/effects.md, ambient). From one
capture, noise is estimated across the raster: on a plane 1/z is linear in the raster, so second differences of 1/z
contain noise and edges only. From several captures it is estimated over time. Both are pooled by amplitude, robustly.
Without an amplitude image 1/z^2 takes its place (inverse square law).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numba import njit

from tof_preproc.stack import LANES

if TYPE_CHECKING:
    from tof_core.arrays import Float, Image, Ints
    from tof_preproc.stack import Stack

BINS = 12
FEWEST = 40
"""Least residuals of a bin; bins with fewer are not used."""
SAMPLES = 16000
"""Degrees of freedom that a law is fitted to: second differences, or deviations over time, of which n captures give n - 1 a pixel."""
LEAST_PIXELS = 3000
"""Pixels that a law is fitted to however many captures there are: 250 in each bin of brightness."""
TINY = 1e-12
"""Least variance, m^2: a micrometre squared."""
EQUAL = 1e-12
"""Share of the squares by which rounding makes a law with more terms look better."""
COLUMNS = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0], [1, 0, 1], [0, 1, 1], [1, 1, 1]], np.bool_)
"""The sets of the law's three terms, few terms first."""
CUT = 9.0
"""Squared residuals beyond three standard deviations are edges or motion, not noise."""


@dataclass(frozen=True, slots=True)
class NoiseLaw:
    """Variance of one capture's depth, m^2: a0 + a1 / A + a2 / A^2, at amplitudes held within [low, high]."""

    coefficients: tuple[float, float, float]
    low: float
    high: float
    by_range: bool = False
    """Whether 1/z^2 takes the place of the amplitude."""

    def sigma(self, depth: Image, amplitude: Image | None) -> Image:
        """Expected standard deviation (H, W) of one capture, metres; finite everywhere."""
        brightness = _brightness(depth, None if self.by_range else amplitude)
        low, high, middle = np.float32(self.low), np.float32(self.high), np.float32(np.sqrt(self.low * self.high))
        a0, a1, a2 = (np.float32(a) for a in self.coefficients)
        return np.asarray(_law(brightness, low, high, middle, a0, a1, a2))


@njit(cache=True, error_model="numpy")
def _law(brightness: Image, low: np.float32, high: np.float32, middle: np.float32, a0: np.float32, a1: np.float32, a2: np.float32) -> Image:
    """The root of the law; at `middle` where the brightness is unknown."""
    height, width = brightness.shape
    out = np.empty((height, width), np.float32)
    for v in range(height):
        for u in range(width):
            value = brightness[v, u]
            inverse = np.float32(1.0) / min(max(value if np.isfinite(value) else middle, low), high)
            out[v, u] = np.sqrt(a0 + inverse * (a1 + inverse * a2))
    return out


def _brightness(depth: Image, amplitude: Image | None) -> Image:
    """(H, W) amplitude, or 1/z^2 without one."""
    if amplitude is not None:
        return amplitude
    with np.errstate(divide="ignore"):
        return np.asarray(1 / (depth * depth))


def law_of_capture(depth: Image, amplitude: Image | None, quantum: float) -> NoiseLaw:
    """The law fitted to one depth image (H, W): from second differences of 1/z across the raster."""
    brightness = _brightness(depth, amplitude)
    noise2, at = zip(*(_second_differences(d, a) for d, a in ((depth, brightness), (depth.T, brightness.T))), strict=True)
    return _fit(np.concatenate(noise2), np.concatenate(at), 1, quantum, by_range=amplitude is None)


def _second_differences(depth: Image, brightness: Image) -> tuple[Float, Float]:
    """Squared noise and brightness of a subset of pixels, from neighbours left and right: var(w- - 2w + w+) = 6 var(w)."""
    step = max(1, round(2 * depth.size / SAMPLES))
    rows = depth[:, ::step] if step < 2 else depth[:: int(np.ceil(np.sqrt(step)))]
    at = brightness[:, ::step] if step < 2 else brightness[:: int(np.ceil(np.sqrt(step)))]
    with np.errstate(divide="ignore", invalid="ignore"):
        w = 1 / rows.astype(float)
        difference = (w[:, :-2] - 2 * w[:, 1:-1] + w[:, 2:]) * rows[:, 1:-1] ** 2
    known = np.isfinite(difference)
    return difference[known] ** 2 / 6, at[:, 1:-1][known].astype(float)


def law_of_dwell(stack: Stack, amplitude: Image | None, quantum: float) -> NoiseLaw:
    """The law fitted to the captures of a dwell, at least 2: from the variance over time of pixels that are valid in all of them."""
    n = stack.captures
    some = np.flatnonzero(stack.count.ravel() == n)
    some = some[:: max(1, some.size // max(SAMPLES // (n - 1), LEAST_PIXELS))]
    if not some.size:
        return NoiseLaw((max(quantum**2 / 12, TINY), 0.0, 0.0), 1.0, 1.0, by_range=amplitude is None)
    means, variances = _moments(_gathered(stack.ordered, some, n))
    brightness = _brightness(means, None if amplitude is None else amplitude.ravel()[some])
    return _fit(variances, np.asarray(brightness, float), n - 1, quantum, by_range=amplitude is None)


@njit(cache=True)
def _gathered(ordered: Image, some: Ints, n: int) -> Float:
    """(n, k) depths of some pixels of a stack."""
    out = np.empty((n, some.size))
    for i in range(some.size):
        b, c = some[i] // LANES, some[i] % LANES
        for j in range(n):
            out[j, i] = ordered[b, j, c]
    return out


@njit(cache=True)
def _moments(values: Float) -> tuple[Float, Float]:
    """Mean and unbiased variance (k,) of values (n, k) over n."""
    n, k = values.shape
    means, variances = np.empty(k), np.empty(k)
    _sum(values, means)
    means /= n
    values = (values - means) * (values - means)
    _sum(values, variances)
    return means, variances / (n - 1)


@njit(cache=True)
def _sum(values: Float, total: Float) -> None:
    """Sum over n in eight strands, as NumPy adds up to 128 values: less rounding than one strand, and the same bits as NumPy."""
    n = values.shape[0]
    whole = n - n % 8
    for k in range(total.size):
        total[k] = 0.0
    if whole:
        strands = values[:8].copy()
        for i in range(8, whole):
            for k in range(total.size):
                strands[i % 8, k] += values[i, k]
        for k in range(total.size):
            near = (strands[0, k] + strands[1, k]) + (strands[2, k] + strands[3, k])
            total[k] = near + ((strands[4, k] + strands[5, k]) + (strands[6, k] + strands[7, k]))
    for i in range(whole, n):
        for k in range(total.size):
            total[k] += values[i, k]


def _fit(noise2: Float, brightness: Float, dof: int, quantum: float, *, by_range: bool) -> NoiseLaw:
    """Bins by brightness, a robust variance in each, and the law through them, none of its terms negative."""
    floor = max(quantum**2 / 12, TINY)
    usable = np.isfinite(brightness) & (brightness > 0)
    order = np.argsort(brightness[usable])
    ascending = brightness[usable][order]
    bins = _bins(ascending)
    if not bins.size:
        everything = noise2[usable] if usable.any() else noise2
        spread = robust_variance(everything, dof, floor) if everything.size else floor
        return NoiseLaw((spread, 0.0, 0.0), 1.0, 1.0, by_range)
    variance = _variances(noise2[usable][order], bins, dof, floor, *_chi2(dof))
    centre = np.array([_middle(ascending[a:b]) for a, b in bins])
    unit = float(np.median(centre))
    powers = (centre[:, None] / unit) ** -np.arange(3.0)
    coefficients = _least_squares(powers / variance[:, None], np.ones(len(bins)))
    a0, a1, a2 = (float(c * unit**p) for p, c in enumerate(coefficients))
    low, high = (_quantile(ascending, q) for q in (0.001, 0.999))
    return NoiseLaw((max(a0, floor) if a1 == a2 == 0 else a0, a1, a2), low, high, by_range)


def _bins(ascending: Float) -> Ints:
    """(n, 2) first index of each bin of ascending values and the one behind its last; the bins are nearly equal in count.

    Equal values share a bin: which of them a sort puts first depends on the processor.
    """
    if not ascending.size:
        return np.empty((0, 2), int)
    cuts = ascending[np.arange(1, BINS) * ascending.size // BINS]
    ends = np.array([0, *np.searchsorted(ascending, cuts), ascending.size])
    bins = np.stack([ends[:-1], ends[1:]], axis=1)
    return np.asarray(bins[bins[:, 1] - bins[:, 0] >= FEWEST])


@njit(cache=True)
def _least_squares(A: Float, b: Float) -> Float:
    """(3,) coefficients, none negative, that minimise |A x - b|: the best of those of all sets of columns, few columns first."""
    best, least, all_of_b = np.zeros(3), float(np.sum(b * b)), float(np.sum(b * b))
    for chosen in COLUMNS:
        x, square = _solved(A, b, chosen)
        if x.min() >= 0 and square < least - EQUAL * all_of_b:
            best, least = x, square
    return best


@njit(cache=True)
def _solved(A: Float, b: Float, chosen: Ints) -> tuple[Float, float]:
    """Least-squares coefficients (3,) of the chosen columns, zero for the others, and the sum of squares left; by Gram-Schmidt.

    A column that depends on those before it gets nothing: the set without it has the same sum.
    """
    Q, R, rest, x = np.zeros((3, b.size)), np.eye(3), b.copy(), np.zeros(3)
    for j in range(3):
        if not chosen[j]:
            continue
        q = A[:, j].copy()
        size = np.sum(q * q)
        for i in range(j):
            R[i, j] = np.sum(Q[i] * q)
            q -= R[i, j] * Q[i]
        left = np.sum(q * q)
        if left > EQUAL * size:
            R[j, j] = np.sqrt(left)
            q /= R[j, j]
            x[j] = np.sum(q * rest)
            rest -= x[j] * q
            for i in range(q.size):
                Q[j, i] = q[i]
    for j in range(2, -1, -1):
        for i in range(j + 1, 3):
            x[j] -= R[j, i] * x[i]
        x[j] /= R[j, j]
    return x, float(np.sum(rest * rest))


def _middle(ascending: Float) -> float:
    """Median of sorted values."""
    half = ascending.size // 2
    return float(ascending[half] if ascending.size % 2 else 0.5 * (ascending[half - 1] + ascending[half]))


def _quantile(ascending: Float, q: float) -> float:
    """Quantile of sorted values, linear between them as NumPy's (which interpolates from the nearer one)."""
    at = q * (ascending.size - 1)
    i = int(at)
    below, above, part = float(ascending[i]), float(ascending[min(i + 1, ascending.size - 1)]), at - i
    return above - (above - below) * (1 - part) if part >= 0.5 else below + (above - below) * part


@lru_cache(maxsize=256)
def _chi2(dof: int) -> tuple[float, float]:
    """Median of chi-square, and the mean of its values up to `CUT` times `dof` as a share of `dof`."""
    from scipy.special import chdtr, chdtri

    return float(chdtri(dof, 0.5)), float(chdtr(dof + 2, CUT * dof) / chdtr(dof, CUT * dof))


def robust_variance(noise2: Float, dof: int, floor: float) -> float:
    """Variance from squared deviations, each of which is a variance estimate with `dof` degrees of freedom.

    The median gives the scale. The result is the mean of the values within three sigma, corrected for the cut:
    a median alone cannot measure noise below the quantisation step.
    """
    return float(_variances(noise2, np.array([[0, noise2.size]]), dof, floor, *_chi2(dof))[0])


@njit(cache=True)
def _variances(noise2: Float, bins: Ints, dof: int, floor: float, middle: float, share: float) -> Float:
    """`robust_variance` of each bin; compiled, since a dozen bins cost NumPy more in calls than in work."""
    out = np.empty(len(bins))
    for i in range(out.size):
        values = noise2[bins[i, 0] : bins[i, 1]]
        scale = np.median(values) * dof / middle
        cut = CUT * max(scale, floor)
        total, kept = 0.0, 0
        for value in values:
            if value <= cut:
                total += value
                kept += 1
        out[i] = max(total / kept / share, floor) if kept else max(scale, floor)
    return out
