# SPDX-License-Identifier: Apache-2.0
"""Two levels of an error over cubes of the cell, or over squares of a plane."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numba import njit

if TYPE_CHECKING:
    from tof_core.arrays import Float

SHARES = (0.02, 0.6)
"""Least and largest share of the pixels' weight at the higher level; a constant over more than half is an offset, whose complement is the region."""


class Levels(NamedTuple):
    """Two levels of an error."""

    low: float
    high: float

    @property
    def middle(self) -> float:
        """The value beyond which the higher level is nearer."""
        return 0.5 * (self.low + self.high)


def levels(means: Float, weight: Float) -> Levels | None:
    """Two levels of the means (n,): those of the split with the largest weighted variance between them (Otsu 1979); None without one."""
    low, high = two_levels(means, weight)
    return None if np.isnan(low) else Levels(low, high)


@njit(cache=True, nogil=True)
def two_levels(means: Float, weight: Float) -> tuple[float, float]:
    """`levels` as (low, high); NaN without them."""
    order = np.argsort(means, kind="mergesort")  # The stable one, by the name that Numba knows.
    total = whole = 0.0
    for k in order:
        total += weight[k]
        whole += weight[k] * means[k]
    below, sums, most, low, high = 0.0, 0.0, -1.0, np.nan, np.nan
    for k in order[:-1]:
        below += weight[k]
        sums += weight[k] * means[k]
        if SHARES[0] < 1.0 - below / total < SHARES[1]:
            between = (sums * total - whole * below) ** 2 / (below * (total - below))
            if between > most:
                most, low, high = between, sums / below, (whole - sums) / (total - below)
    return low, high
