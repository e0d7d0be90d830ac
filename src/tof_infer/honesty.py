# SPDX-License-Identifier: Apache-2.0
"""From the scale that the loss taught to a sigma that holds what it says: 68 % of errors within one, 95 % within two."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from tof_core.arrays import Float

BINS = 12


@dataclass(frozen=True, slots=True)
class Calibration:
    """sigma = exp(offset + slope * log(scale))."""

    offset: float = 0.0
    slope: float = 1.0

    def sigma(self, log_scale: Float) -> Float:
        """Standard deviations of logs of scales, metres."""
        return np.asarray(np.exp(self.offset + self.slope * log_scale))


def calibrate(error: Float, log_scale: Float) -> Calibration:
    """Fit on validation pixels (n,): in bins of the scale, between the 68 % quantile of errors and half of the 95 % one.

    Errors have longer tails than the normal law, so no factor meets both; this one misses both by little.
    """
    order = np.argsort(log_scale)
    bins = [b for b in np.array_split(order, BINS) if len(b) >= 20]
    if not bins:
        return Calibration()
    e = np.abs(error)
    wanted = np.array([0.5 * (np.log(np.quantile(e[b], 0.6827) + 1e-9) + np.log(np.quantile(e[b], 0.9545) / 2 + 1e-9)) for b in bins])
    at = np.array([np.median(log_scale[b]) for b in bins])
    if np.ptp(at) < 0.1:
        return Calibration(float(np.mean(wanted - at)), 1.0)
    slope = float(np.clip(np.polyfit(at, wanted, 1)[0], 0.5, 1.5))
    return Calibration(float(np.mean(wanted - slope * at)), slope)


def coverage(error: Float, sigma: Float) -> tuple[float, float]:
    """Shares of errors within one and within two sigma."""
    ratio = np.abs(error) / sigma
    return float(np.mean(ratio <= 1)), float(np.mean(ratio <= 2))
