# SPDX-License-Identifier: Apache-2.0
"""How much one capture scatters: a photon law of amplitude, fitted to the captures themselves.

Shot and ambient noise give a variance a0 + a1 / A + a2 / A^2 of depth at the amplitude A (quantisation; photons of the
light; photons of the ambient light and the circuit's noise). With one capture the scatter is read across the raster:
1/z is linear in the raster wherever the surface is a plane, so its second differences are noise and edges. With more
it is read over time. Both are pooled by amplitude, robustly; without an amplitude 1/z^2 stands for it (the light's
fall with distance).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numba import njit
from scipy.optimize import nnls
from scipy.special import chdtr, chdtri

if TYPE_CHECKING:
    from tof_core.arrays import Float, Image
    from tof_preproc.stack import Stack

BINS = 12
FEWEST = 40
"""Residuals in a bin below which it says nothing."""
SAMPLES = 16000
TINY = 1e-12
"""Variance in m^2 below which there is none: a micrometre squared."""
CUT = 9.0
"""Squared residuals beyond three standard deviations are edges or moving things, not noise."""


@dataclass(frozen=True, slots=True)
class NoiseLaw:
    """Variance of one capture's depth, m^2: a0 + a1 / A + a2 / A^2, at amplitudes held within [low, high]."""

    coefficients: tuple[float, float, float]
    low: float
    high: float
    by_range: bool = False
    """Whether 1/z^2 stands for the amplitude."""

    def sigma(self, depth: Image, amplitude: Image | None) -> Image:
        """Expected standard deviation (H, W) of one capture, metres; finite everywhere."""
        light = _light(depth, None if self.by_range else amplitude)
        middle = np.float32(np.sqrt(self.low * self.high))
        inverse = 1 / np.clip(np.where(np.isfinite(light), light, middle), self.low, self.high)
        a0, a1, a2 = (np.float32(a) for a in self.coefficients)
        return np.sqrt(a0 + inverse * (a1 + inverse * a2), dtype=np.float32)


def _light(depth: Image, amplitude: Image | None) -> Image:
    if amplitude is not None:
        return amplitude
    with np.errstate(divide="ignore"):
        return np.asarray(1 / (depth * depth))


def law_of_capture(depth: Image, amplitude: Image | None, quantum: float) -> NoiseLaw:
    """The law as one depth image (H, W) tells it: from second differences of 1/z across the raster."""
    light = _light(depth, amplitude)
    scatter2, at = zip(*(_second_differences(d, a) for d, a in ((depth, light), (depth.T, light.T))), strict=True)
    return _fit(np.concatenate(scatter2), np.concatenate(at), 1, quantum, by_range=amplitude is None)


def _second_differences(depth: Image, light: Image) -> tuple[Float, Float]:
    """Squared scatter and light of a subset of pixels, from neighbours left and right: var(w- - 2w + w+) = 6 var(w)."""
    step = max(1, round(2 * depth.size / SAMPLES))
    rows = depth[:, ::step] if step < 2 else depth[:: int(np.ceil(np.sqrt(step)))]
    lights = light[:, ::step] if step < 2 else light[:: int(np.ceil(np.sqrt(step)))]
    with np.errstate(divide="ignore", invalid="ignore"):
        w = 1 / rows.astype(float)
        scatter = (w[:, :-2] - 2 * w[:, 1:-1] + w[:, 2:]) * rows[:, 1:-1] ** 2
    known = np.isfinite(scatter)
    return scatter[known] ** 2 / 6, lights[:, 1:-1][known].astype(float)


def law_of_dwell(stack: Stack, amplitude: Image | None, quantum: float) -> NoiseLaw:
    """The law as the captures of a dwell tell it, at least 2: from the scatter over time of pixels that all of them have."""
    n = stack.captures
    some = np.flatnonzero(stack.count == n)
    some = some[:: max(1, some.size // SAMPLES)]
    if not some.size:
        return NoiseLaw((max(quantum**2 / 12, TINY), 0.0, 0.0), 1.0, 1.0, by_range=amplitude is None)
    means, variances = _moments(stack.ordered, some, n)
    light = _light(means, None if amplitude is None else amplitude.ravel()[some])
    return _fit(variances, np.asarray(light, float), n - 1, quantum, by_range=amplitude is None)


@njit(cache=True)
def _moments(ordered, some, n):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Mean and unbiased variance of the first n values of some rows."""
    means, variances, row, strands = np.empty(some.size), np.empty(some.size), np.empty(n), np.empty(8)
    for i in range(some.size):
        for j in range(n):
            row[j] = ordered[some[i], j]
        means[i] = _sum(row, strands) / n
        for j in range(n):
            row[j] = (row[j] - means[i]) * (row[j] - means[i])
        variances[i] = _sum(row, strands) / (n - 1)
    return means, variances


@njit(cache=True)
def _sum(row, r):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Sum in eight strands, as NumPy adds up to 128 values: rounds less than one, and gives its bits."""
    whole = row.size - row.size % 8
    total = 0.0
    if whole:
        r[:] = row[:8]
        for i in range(8, whole, 8):
            for j in range(8):
                r[j] += row[i + j]
        total = ((r[0] + r[1]) + (r[2] + r[3])) + ((r[4] + r[5]) + (r[6] + r[7]))
    for i in range(whole, row.size):
        total += row[i]
    return total


def _fit(scatter2: Float, light: Float, dof: int, quantum: float, *, by_range: bool) -> NoiseLaw:
    """Bins of equal count by light, a robust variance in each, and the law through them, none of its terms negative."""
    floor = max(quantum**2 / 12, TINY)
    usable = np.isfinite(light) & (light > 0)
    order = np.argsort(light[usable])
    bins = [b for b in np.array_split(order, BINS) if b.size >= FEWEST]
    if not bins:
        everything = scatter2[usable] if usable.any() else scatter2
        spread = robust_variance(everything, dof, floor) if everything.size else floor
        return NoiseLaw((spread, 0.0, 0.0), 1.0, 1.0, by_range)
    light, scatter2 = light[usable], scatter2[usable]
    variance = np.array([robust_variance(scatter2[b], dof, floor) for b in bins])
    centre = np.array([_middle(light[b]) for b in bins])
    unit = float(np.median(centre))
    powers = (centre[:, None] / unit) ** -np.arange(3.0)
    coefficients, _ = nnls(powers / variance[:, None], np.ones(len(bins)))
    a0, a1, a2 = (float(c * unit**p) for p, c in enumerate(coefficients))
    low, high = (float(v) for v in np.quantile(light, (0.001, 0.999)))
    return NoiseLaw((max(a0, floor) if a1 == a2 == 0 else a0, a1, a2), low, high, by_range)


def _middle(ascending: Float) -> float:
    """Median of sorted values."""
    half = ascending.size // 2
    return float(ascending[half] if ascending.size % 2 else 0.5 * (ascending[half - 1] + ascending[half]))


def robust_variance(scatter2: Float, dof: int, floor: float) -> float:
    """Variance behind squared deviations of which each is one variance estimate with `dof` degrees of freedom.

    The median finds the scale; the mean of what lies within three sigma of it, corrected for the cut, is the answer
    (a median alone cannot see noise below the quantisation step).
    """
    scale = float(np.median(scatter2)) * dof / float(chdtri(dof, 0.5))
    cut = CUT * max(scale, floor)
    kept = scatter2[scatter2 <= cut]
    share = chdtr(dof + 2, CUT * dof) / chdtr(dof, CUT * dof)
    return max(float(kept.mean()) / float(share), floor) if kept.size else max(scale, floor)
