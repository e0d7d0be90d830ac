# SPDX-License-Identifier: Apache-2.0
"""How far stated probabilities are from how often they are right."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

BINS = 10
"""Equal steps of probability; 1 belongs to the last."""


def calibration_error(probability: ArrayLike, right: ArrayLike) -> float:
    """Expected calibration error: mean over all statements of |stated - share right| in the bin that the stated one falls into."""
    p, hit = np.asarray(probability, float), np.asarray(right, float)
    bins = np.clip((BINS * p).astype(int), 0, BINS - 1)
    return float(sum(abs(p[bins == b].mean() - hit[bins == b].mean()) * (bins == b).mean() for b in np.unique(bins)))


def brier(probability: ArrayLike, right: ArrayLike) -> float:
    """Mean square of what was stated less what is: 0 is perfect, 0.25 a coin."""
    return float(np.mean((np.asarray(probability, float) - np.asarray(right, float)) ** 2))
