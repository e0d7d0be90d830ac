# SPDX-License-Identifier: Apache-2.0
"""Noise of a view, estimated from differences between neighbouring pixels, and the step of its depth code."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tof_core.stats import second_differences, trimmed_std
from tof_gap.seen.correlation import INDEPENDENT

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Float, Mask
    from tof_gap.limits.seen import LevelLimits
    from tof_gap.seen.correlation import NoiseCorrelation

DARK = 1e-12
"""Amplitude that replaces 0 before the logarithm is taken."""


def noise_level(residual: Float, keep: Mask, amplitude: Float, limits: LevelLimits, correlation: NoiseCorrelation = INDEPENDENT) -> Float:
    """(H, W) metres of z: standard deviation of the noise in a residual (H, W), as a function of amplitude (H, W).

    Second differences along rows and columns of the pixels to `keep` remove smooth errors. Their trimmed standard deviation in bins of
    amplitude is interpolated in ln amplitude; beyond the bins, that of the nearest bin holds. correlation: where neighbours share noise,
    it is read from how the differences grow with the distance of the pixels.
    """
    r = np.where(keep, residual, np.nan)
    near = [_differences(r, amplitude, step) for step in correlation.steps]
    d2, log = near[0]
    if len(d2) < limits.samples:
        return np.full(residual.shape, limits.unknown_mm * 1e-3)
    edges = np.unique(np.quantile(log, np.linspace(0, 1, limits.bins + 1)))
    ends = [[0, *np.searchsorted(light, edges[1:-1]), len(light)] for _, light in near]
    centres, sizes = [], []
    for k in range(len(edges) - 1):
        bins = [(x[e[k] : e[k + 1]], light[e[k] : e[k + 1]]) for (x, light), e in zip(near, ends, strict=True)]
        if min(len(x) for x, _ in bins) >= limits.bin_samples:
            centres.append(float(bins[0][1].mean()))
            sizes.append(_std(bins, correlation))
    if not centres:
        return np.full(residual.shape, _std(near, correlation))
    return np.interp(np.log(np.maximum(amplitude, DARK)), centres, np.maximum(sizes, limits.least_mm * 1e-3))


def _std(differences: Sequence[tuple[Float, Float]], correlation: NoiseCorrelation) -> float:
    """Standard deviation of one pixel's noise by second differences (and ln amplitude) of pixels `correlation.steps` apart."""
    return float(np.sqrt(correlation.variance([trimmed_std(d2) ** 2 for d2, _ in differences])))


def _differences(residual: Float, amplitude: Float, step: int) -> tuple[Float, Float]:
    """(n,) second differences of pixels `step` apart along rows and columns, and ln amplitude of their middle, in order of the latter."""
    samples, light = [], []
    for axis in (0, 1):
        d2 = second_differences(residual, axis, step)
        middle = np.moveaxis(np.moveaxis(amplitude, axis, 0)[step:-step], 0, axis)
        seen = np.isfinite(d2) & (middle > 0)
        samples.append(d2[seen])
        light.append(np.log(middle[seen]))
    d2_all, log = np.concatenate(samples), np.concatenate(light)
    order = np.argsort(log, kind="stable")
    return d2_all[order], log[order]


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
