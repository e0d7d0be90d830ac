# SPDX-License-Identifier: Apache-2.0
"""Noise of a view, estimated from differences between neighbouring pixels, and the step of its depth code."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numba import njit

from tof_core.stats import SECOND_DIFFERENCE_STD, trimmed_std
from tof_gap.seen.evidence.correlation import INDEPENDENT

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Float, Ints, Mask
    from tof_gap.limits.evidence import LevelLimits
    from tof_gap.seen.evidence.correlation import NoiseCorrelation

DARK = 1e-12
"""Amplitude that replaces 0 before the logarithm is taken."""
CELLS = 1024
"""Equal cells over the span of all bins, in which a sample's bin is looked up."""


def noise_level(residual: Float, keep: Mask, amplitude: Float, limits: LevelLimits, correlation: NoiseCorrelation = INDEPENDENT) -> Float:
    """(H, W) metres of z: standard deviation of the noise in a residual (H, W), as a function of amplitude (H, W).

    Second differences along rows and columns of the pixels to `keep` remove smooth errors. Their trimmed standard deviation in bins of
    amplitude is interpolated in ln amplitude; beyond the bins, that of the nearest bin holds. correlation: where neighbours share noise,
    it is read from how the differences grow with the distance of the pixels.
    """
    r = np.where(keep, residual, np.nan).astype(np.float64)
    light = np.log(np.maximum(amplitude, DARK))
    log = np.where(amplitude > 0, light, -np.inf).astype(np.float64)
    near = [_differences(r, log, step) for step in correlation.steps]
    if len(near[0][0]) < limits.samples:
        return np.full(residual.shape, limits.unknown_mm * 1e-3)
    edges = np.unique(_quantiles(np.sort(near[0][1]), limits.bins))
    by_step = [_binned(d2, log, edges[1:-1]) for d2, log in near]
    centres, sizes = [], []
    for k in range(len(edges) - 1):
        samples = [d2[starts[k] : starts[k + 1]] for d2, starts, _ in by_step]
        if min(map(len, samples)) >= limits.bin_samples:
            centres.append(float(by_step[0][2][k]) / len(samples[0]))
            sizes.append(_std(samples, correlation))
    if not centres:
        return np.full(residual.shape, _std([d2 for d2, _ in near], correlation))
    return np.interp(light, centres, np.maximum(sizes, limits.least_mm * 1e-3))


def _std(differences: Sequence[Float], correlation: NoiseCorrelation) -> float:
    """Standard deviation of one pixel's noise by second differences of pixels `correlation.steps` apart."""
    return float(np.sqrt(correlation.variance([trimmed_std(d2) ** 2 for d2 in differences])))


def _quantiles(ascending: Float, bins: int) -> Float:
    """(bins + 1,) quantiles of sorted samples that delimit `bins` bins of equal numbers: `np.quantile` would sort them again."""
    at = np.linspace(0.0, 1.0, bins + 1) * (len(ascending) - 1)
    low = np.minimum(at.astype(np.int64), len(ascending) - 2)
    a, b, t = ascending[low], ascending[low + 1], at - low
    return np.asarray(np.where(t < 0.5, a + (b - a) * t, b - (b - a) * (1.0 - t)))


@njit(cache=True, nogil=True)
def _differences(residual: Float, log: Float, step: int) -> tuple[Float, Float]:
    """(n,) second differences (`stats.second_differences`) of pixels `step` apart along columns and rows, and ln amplitude of their middle.

    residual (H, W): NaN at pixels that do not count; log (H, W): not finite without light.
    """
    h, w = residual.shape
    d2, light, n = np.empty(2 * h * w), np.empty(2 * h * w), 0
    for dv, du in ((step, 0), (0, step)):
        for v in range(dv, h - dv):
            for u in range(du, w - du):
                b = residual[v, u]
                second = ((residual[v + dv, u + du] - b) - (b - residual[v - dv, u - du])) / SECOND_DIFFERENCE_STD
                if np.isfinite(second) and np.isfinite(log[v, u]):
                    d2[n], light[n] = second, log[v, u]
                    n += 1
    return d2[:n], light[:n]


@njit(cache=True, nogil=True)
def _bins_of(values: Float, inner: Float) -> Ints:
    """(n,) number of ascending edges at or below each value: a bisection, whose steps no processor predicts, takes several times as long."""
    out = np.zeros(len(values), np.int64)
    if len(inner) == 0:
        return out
    span = inner[-1] - inner[0]
    per_value = (CELLS - 1) / span if span > 0.0 else 0.0
    below = np.searchsorted(inner, inner[0] + np.arange(CELLS) * span / (CELLS - 1) - span / CELLS, side="right")
    for i in range(len(values)):
        cell = (values[i] - inner[0]) * per_value
        k = below[int(min(max(cell, 0.0), CELLS - 1.0))]
        while k < len(inner) and inner[k] <= values[i]:
            k += 1
        out[i] = k
    return out


@njit(cache=True, nogil=True)
def _binned(samples: Float, log: Float, inner: Float) -> tuple[Float, Ints, Float]:
    """Samples (n,) in order of the bins that the ascending edges `inner` (bins - 1,) make of `log` (n,); (bins + 1,) where each bin starts; (bins,) sums of `log`."""
    which, bins = _bins_of(log, inner), len(inner) + 1
    starts, sums = np.zeros(bins + 1, np.int64), np.zeros(bins)
    for i in range(len(samples)):
        starts[which[i] + 1] += 1
        sums[which[i]] += log[i]
    starts = np.cumsum(starts)
    out, free = np.empty_like(samples), starts.copy()
    for i in range(len(samples)):
        out[free[which[i]]] = samples[i]
        free[which[i]] += 1
    return out, starts, sums


def depth_step(depth: Float, limits: LevelLimits, captures: int = 1) -> float:
    """Metres between the codes of a depth image (H, W), the mean of `captures` captures; 0 where depth is continuous.

    A mean of captures may lie between two codes. If noise exceeds the step, all fractions of a step occur equally often; else most
    pixels of the mean have whole codes, and the step is that of one capture.
    """
    z = depth[np.isfinite(depth)].astype(np.float64)
    if len(z) < limits.code_pixels:
        return 0.0
    codes = np.unique(np.round(z, 6))
    gaps = np.diff(codes)
    gaps = gaps[gaps > limits.code_gap_mm * 1e-3]
    if len(gaps) < limits.code_gaps or len(codes) > limits.code_share * len(z):
        return 0.0
    between = float(np.median(gaps))
    if captures == 1:
        return between
    step = captures * between
    off = np.abs(z / step - np.rint(z / step)) * step
    alike = float(np.mean(off < 0.5 * between))
    return step if 1.0 > alike > limits.code_whole / captures else between
