# SPDX-License-Identifier: Apache-2.0
"""Cubes of the cell, and those at the higher of two levels of an error (T. Chan, L. Vese, Active contours without edges, 2001)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse import coo_array, eye_array
from scipy.spatial import cKDTree

from tof_gap.solve.hypotheses.levels import levels

if TYPE_CHECKING:
    from scipy.sparse import csr_array

    from tof_core.arrays import Float, Ints, Mask
    from tof_gap.solve.hypotheses.sheet import Sheet

AROUND = 1.8
"""Sides of a cube within which the centres of those lie that touch it, 26 and itself."""
SHARED = 20.0
"""Pixels that share one error of other effects, by which pixels weigh less against the poses' prior."""
TOUCHING = 1.0
"""Chi-square that two touching cubes of different levels cost: values of 0.3 to 3 find the same regions in five sessions with a pane."""
SWEEPS = 4
"""Sweeps over all cubes: a change travels by one cube a sweep, and specks of noise are smaller than four."""


@dataclass(frozen=True, slots=True, eq=False)
class Cells:
    """Cubes of the cell of `side` metres from the corner `low` (3,), by their numbers in a grid of `shape`; `inside` of them are the region.

    sheet: the plane on which the region lies; None for a region of the surfaces.
    """

    side: float
    low: Float
    shape: tuple[int, int, int]
    inside: Ints
    sheet: Sheet | None = None

    def corners(self, points: Float) -> Float:
        """(n, 3) cubes of points (n, 3) in metres, counted along the grid's axes; whole numbers, outside of the grid too."""
        return np.asarray(np.floor(points / self.side) - self.low)

    def contain(self, points: Float) -> Mask:
        """(n,) whether points (n, 3) in metres lie in the region; False for NaN."""
        at = self.corners(np.nan_to_num(points, nan=np.inf, posinf=1e6))
        within = np.all((at >= 0) & (at < self.shape), axis=1)
        number = np.ravel_multi_index(tuple(np.where(within[:, None], at, 0).astype(np.int64).T), self.shape)
        return np.asarray(within & np.isin(number, self.inside))

    def hold(self, origin: Float, points: Float) -> Mask:
        """(n,) whether the light from points (n, 3) to the camera at `origin` (3,), both in metres, passes the region."""
        return self.contain(points if self.sheet is None else self.sheet.crossings(origin, points))


def touching(corners: Ints) -> csr_array:
    """(n, n) sparse: which cubes, by their corners (n, 3), touch each other; a cube touches itself."""
    pairs = cKDTree(corners).query_pairs(AROUND, output_type="ndarray")
    one = coo_array((np.ones(len(pairs)), pairs.T), (len(corners), len(corners)))
    return (one + one.T + eye_array(len(corners))).tocsr()


def at_higher_level(sums: Float, weight: Float, around: csr_array) -> Mask:
    """(n,) cubes at the higher of two levels; sums (n,): of weighted errors; `around` (n, n): which cubes touch.

    The levels are those of means over neighbours. A cube then takes the level that its own mean and its neighbours' levels make likelier
    (iterated conditional modes: J. Besag, On the statistical analysis of dirty pictures, J. Royal Statistical Society B 48, 1986).
    """
    means, smoothed = sums / weight, (around @ sums) / (around @ weight)
    found = levels(smoothed, weight)
    if found is None:
        return np.zeros(len(sums), bool)
    own = (means - found.middle) * (found.high - found.low) * weight / SHARED
    inside = smoothed > found.middle
    for _ in range(SWEEPS):
        inside = np.asarray(own + TOUCHING * (around @ (2.0 * inside - 1.0)) > 0)
    return np.asarray(inside)
