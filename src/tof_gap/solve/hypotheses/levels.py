# SPDX-License-Identifier: Apache-2.0
"""Two levels of an error over cubes of the cell, or over squares of a plane."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

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
    if not len(means):
        return None
    order = np.argsort(means, kind="stable")
    below, sums = np.cumsum(weight[order]), np.cumsum(weight[order] * means[order])
    total, whole = below[-1], sums[-1]
    share = 1.0 - below[:-1] / total
    allowed = (share > SHARES[0]) & (share < SHARES[1])
    if not allowed.any():
        return None
    between = (sums[:-1] * total - whole * below[:-1]) ** 2 / (below[:-1] * (total - below[:-1]))
    at = int(np.argmax(np.where(allowed, between, -1.0)))
    return Levels(float(sums[at] / below[at]), float((whole - sums[at]) / (total - below[at])))
