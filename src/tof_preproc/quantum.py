# SPDX-License-Identifier: Apache-2.0
"""The quantisation step of a sensor's depth, and the error of averages of quantised values."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numba import njit

if TYPE_CHECKING:
    from tof_core.arrays import Image

FINEST, COARSEST = 2e-5, 2e-2
"""Range of steps, metres; finer ones are far below any noise."""
DITHERED = 1.5
"""Variance in squared steps above which the bias is lost in the rounding of the rest (exp(-59), for up to 256 captures)."""


def quantum_of(depth: Image, samples: int = 20000) -> float:
    """Quantisation step of a depth image (H, W), metres; 0 where the values have no common step.

    The smallest gap between values is a candidate; it is the step if every value is a whole number of them.
    """
    values = depth.ravel()[:: max(1, depth.size // samples)]
    values = np.unique(values[np.isfinite(values)].astype(float))
    gaps = np.diff(values)
    gaps = gaps[gaps > FINEST / 2]
    if gaps.size < 2:
        return 0.0
    step = float(gaps.sum() / np.round(gaps / gaps.min()).sum())
    steps = values / step
    rounding = np.spacing(np.float32(values[-1])) / step
    on_code = np.abs(steps - np.round(steps)).max() < 0.02 + 2 * rounding
    return step if on_code and FINEST <= step <= COARSEST else 0.0


@njit(cache=True)
def mean_error2(variance: float, factor: float, quantum: float, on_code: bool) -> float:  # noqa: FBT001  (compiled: positional)
    """Squared standard error of a mean of quantised values; of a median (`on_code`), which is a code itself.

    `variance` is one value's, its quantisation included; `factor` the sum of the squared weights. Noise well above the
    step q dithers the rounding error. Otherwise a bias remains that no number of captures averages out. Its mean square
    over all positions between two codes is q^2 / (2 pi^2) sum_k exp(-4 pi^2 k^2 s^2 / q^2) / k^2, with s the noise
    before quantisation (Fourier series of the rounding error). Without noise it is q^2 / 12.
    """
    if quantum <= 0.0:
        return variance * factor
    q2 = quantum * quantum
    ratio = max(variance - q2 / 12, 0.0) / q2
    if on_code or ratio <= 1e-3:
        bias2 = q2 / 12
    elif ratio < DITHERED:
        bias2 = _series(ratio) * (q2 / (2 * np.pi**2))
    else:
        return variance * factor
    return max(variance - bias2, 0.0) * factor + bias2


@njit(cache=True)
def _series(ratio: float) -> float:
    """The sum above as a function of (s / q)^2; it ends at the first term that is lost in rounding."""
    total = 0.0
    for k in range(1, 12):
        before = total
        total += np.exp(-4 * np.pi**2 * k * k * ratio) / (k * k)
        if total == before:
            break
    return total
