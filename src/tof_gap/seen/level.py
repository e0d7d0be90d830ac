# SPDX-License-Identifier: Apache-2.0
"""Noise of a view, estimated from differences between neighbouring pixels, and the step of its depth code."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING

import numpy as np

from tof_core.stats import second_differences, trimmed_std

if TYPE_CHECKING:
    from tof_core.arrays import Float, Mask
    from tof_gap.limits.seen import LevelLimits

DARK = 1e-12
"""Amplitude that replaces 0 before the logarithm is taken."""


def noise_level(residual: Float, keep: Mask, amplitude: Float, limits: LevelLimits) -> Float:
    """(H, W) metres of z: standard deviation of the white noise in a residual (H, W), as a function of amplitude (H, W).

    Second differences along rows and columns of the pixels to `keep` remove smooth errors. Their trimmed standard deviation in bins of
    amplitude is interpolated in ln amplitude; beyond the bins, that of the nearest bin holds.
    """
    r = np.where(keep, residual, np.nan)
    samples, light = [], []
    for axis in (0, 1):
        d2 = second_differences(r, axis)
        middle = np.delete(np.delete(amplitude, 0, axis), -1, axis)
        seen = np.isfinite(d2) & (middle > 0)
        samples.append(d2[seen])
        light.append(np.log(middle[seen]))
    d2_all, log = np.concatenate(samples), np.concatenate(light)
    if len(d2_all) < limits.samples:
        return np.full(residual.shape, limits.unknown_mm * 1e-3)
    order = np.argsort(log)
    d2_all, log = d2_all[order], log[order]
    edges = np.unique(np.quantile(log, np.linspace(0, 1, limits.bins + 1)))
    centres, sizes = [], []
    for a, b in itertools.pairwise([0, *np.searchsorted(log, edges[1:-1]), len(log)]):
        if b - a >= limits.bin_samples:
            centres.append(float(log[a:b].mean()))
            sizes.append(trimmed_std(d2_all[a:b]))
    if not centres:
        return np.full(residual.shape, trimmed_std(d2_all))
    return np.interp(np.log(np.maximum(amplitude, DARK)), centres, np.maximum(sizes, limits.least_mm * 1e-3))


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
