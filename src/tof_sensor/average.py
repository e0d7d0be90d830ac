# SPDX-License-Identifier: Apache-2.0
"""Noise of a camera that averages depth over those neighbours that differ by less than a threshold (a bilateral filter's core).

Where noise is far below the threshold, all neighbours are taken in; where it is far above, hardly any, and the noise stays. Between, the variance
grows faster than that before the average: dark pixels are noisier than any law of photons says.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from tof_core.arrays import Float

THRESHOLDS = np.concatenate([[1e-3], np.geomspace(0.02, 50.0, 160), [1e4]])
"""Thresholds, in standard deviations of the noise before the average, at which the variance after it is computed."""
OWN = np.linspace(-5.0, 5.0, 201)
"""Errors of the pixel itself, in standard deviations, over which the variance is integrated."""


def averaged(variance: Float, pixels: int, within_m: float) -> Float:
    """Variance (n,) after an average over `pixels` that differ by less than `within_m` metres, from that before it, both in m^2."""
    before, after = _curve(pixels)
    return np.asarray(within_m**2 * np.exp(np.interp(np.log(np.maximum(variance, 1e-20) / within_m**2), before, after)))


def before_average(variance: Float, pixels: int, within_m: float) -> Float:
    """The inverse of `averaged`."""
    before, after = _curve(pixels)
    return np.asarray(within_m**2 * np.exp(np.interp(np.log(np.maximum(variance, 1e-20) / within_m**2), after, before)))


@lru_cache(maxsize=16)
def _curve(pixels: int) -> tuple[Float, Float]:
    """(k,) ascending ln variance before and after the average, in squares of the threshold.

    A pixel with the error x takes in each neighbour y with |y - x| < s, for normal x and y of variance 1. Of these neighbours, the share, the mean and
    the variance follow from the truncated normal distribution.
    """
    from scipy.special import ndtr  # loads slowly, and few cameras average

    x, s = OWN[:, None], THRESHOLDS
    weight = np.exp(-(x**2) / 2)
    weight /= weight.sum()
    low, high = (np.exp(-((x + sign * s) ** 2) / 2) / np.sqrt(2 * np.pi) for sign in (-1.0, 1.0))
    share = np.maximum(ndtr(x + s) - ndtr(x - s), 1e-300)
    mean = (low - high) / share
    spread = np.maximum(1.0 + ((x - s) * low - (x + s) * high) / share - mean**2, 0.0)
    taken = (pixels - 1) * share
    after = (weight * (((x + taken * mean) / (1.0 + taken)) ** 2 + taken * spread / (1.0 + taken) ** 2)).sum(axis=0)
    before = -2.0 * np.log(s)
    return before[::-1], (np.log(after) + before)[::-1]
