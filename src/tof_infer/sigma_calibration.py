# SPDX-License-Identifier: Apache-2.0
"""Calibration of sigma from the trained scale: 68 % of errors within one sigma, 95 % within two."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from tof_core.arrays import Float

BINS = 42
"""Bins of the scale over which the slope is fitted."""
LEFT_WRONG = 0.06
"""Largest share of flying pixels that may be corrected and still be wrong."""
LEAST_CORRECTED = 0.88
"""Least share of all pixels that is corrected."""


@dataclass(frozen=True, slots=True)
class Calibration:
    """sigma = exp(offset + slope * log(scale))."""

    offset: float = 0.0
    slope: float = 1.0

    def sigma(self, log_scale: Float) -> Float:
        """Standard deviations in metres of log scales."""
        return np.asarray(np.exp(self.offset + self.slope * log_scale))


def calibrate(error: Float, log_scale: Float, own: Float | None = None) -> Calibration:
    """Fit on validation pixels (n,): the slope over bins of the scale, then the factor.

    Errors have longer tails than a normal distribution, so no factor meets both shares; this factor misses both by little. Only
    pixels whose scale from their surroundings (`own`, default `log_scale`) is small enough to be used count.
    """
    order = np.argsort(log_scale, kind="stable")
    bins = [b for b in np.array_split(order, BINS)[1:-1] if len(b) >= 20]  # the outermost bins are too wide
    if not bins:
        return Calibration()
    e = np.abs(error)
    wanted = np.array([0.5 * (np.log(np.quantile(e[b], 0.6827) + 1e-9) + np.log(np.quantile(e[b], 0.9545) / 2 + 1e-9)) for b in bins])
    at = np.array([np.median(log_scale[b]) for b in bins])
    slope = float(np.clip(np.polyfit(at, wanted, 1)[0], 0.5, 1.5)) if np.ptp(at) > 0.1 else 1.0
    offset = float(np.mean(wanted - slope * at))
    small = (order if own is None else np.argsort(own, kind="stable"))[: int(LEAST_CORRECTED * len(order))]
    ratio = e[small] / Calibration(offset, slope).sigma(log_scale[small])
    return Calibration(offset + _best_shift(ratio), slope)


def _best_shift(ratio: Float) -> float:
    """Log of the factor at which the shares within one and two come nearest to 68 and 95 %, in units of their tolerances."""
    shifts = np.linspace(-0.7, 0.7, 141)
    one, two = (np.searchsorted(np.sort(ratio), k * np.exp(shifts), side="right") / len(ratio) for k in (1, 2))
    return float(shifts[np.argmin(np.maximum(np.abs(one - 0.6827) / 0.05, np.abs(two - 0.9545) / 0.03))])


def sigma_limit(error: Float, raw_error: Float, sigma: Float) -> float:
    """Sigma in metres above which the raw depth is kept.

    It is the largest value at which, of the pixels whose raw error exceeds 20 mm (flying pixels), at most the share
    `LEFT_WRONG` is corrected and still more than 10 mm off. At least the share `LEAST_CORRECTED` of all pixels is corrected.
    """
    order = np.argsort(sigma, kind="stable")
    flying = np.abs(raw_error[order]) > 0.02
    left = np.cumsum(flying & (np.abs(error[order]) > 0.01)) / max(int(flying.sum()), 1)
    enough = int(np.searchsorted(left, LEFT_WRONG, side="right"))
    last = int(np.clip(max(enough, LEAST_CORRECTED * len(order)), 1, len(order))) - 1
    return float(sigma[order[last]])


def coverage(error: Float, sigma: Float) -> tuple[float, float]:
    """Shares of errors within one and within two sigma."""
    ratio = np.abs(error) / sigma
    return float(np.mean(ratio <= 1)), float(np.mean(ratio <= 2))
