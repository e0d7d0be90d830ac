# SPDX-License-Identifier: Apache-2.0
"""How much of the errors of rays a region of a plane explains: a search asks that of a thousand planes."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numba import njit

from tof_gap.solve.hypotheses.levels import two_levels

if TYPE_CHECKING:
    from tof_core.arrays import Float, Ints, Mask

MOST_RAYS = 4000
"""Rays that planes are compared by: some ten in a square. Of 3000, half of the planes of seven panes were off by more than their search steps."""
SIDE_M = 0.08
"""Side in metres of the squares of a plane: regions are decimetres wide."""
NEAREST_M = 0.05
"""Metres before the camera within which a plane is part of it, as its cover glass is."""


class Rays(NamedTuple):
    """Rays from origin (n, 3) to point (n, 3) in metres, the error along each (n,) in metres, its weight (n,), and the fold of its view (n,)."""

    origin: Float
    point: Float
    error_m: Float
    weight: Float
    fold: Ints

    def some(self) -> Rays:
        """`MOST_RAYS` of them at most, evenly over all."""
        at = np.linspace(0, len(self.fold) - 1, min(len(self.fold), MOST_RAYS)).astype(np.int64)
        return Rays(self.origin[at], self.point[at], self.error_m[at], self.weight[at], self.fold[at])


@njit(cache=True, nogil=True)
def explained(rays: Rays, normal: Float, offset_m: float, across: Float, pairs: Ints, folds: int) -> Float:
    """(folds,) what a region of the plane explains of the errors of all other folds, each as the rest of them tell; 0 without a rest.

    The region is the squares at the higher of two levels. By the same views, squares of few rays would explain noise, and those of a plane
    close to the cameras, which no two views share, anything.

    Args:
        rays: their folds are numbered from 0 to `folds` - 1.
        normal: (3,), of the points x of the plane: normal @ x = offset_m.
        offset_m: distance of the plane from the origin of the cell.
        across: (2, 3) two directions in the plane, along which its squares lie.
        pairs: (p, 2) the folds that the rest is without.
        folds: how many there are.
    """
    square, many = _squares(crossings(rays.origin, rays.point, normal, offset_m), across)
    weights, sums = np.zeros((folds, many)), np.zeros((folds, many))
    for i in range(len(square)):
        weights[rays.fold[i], square[i]] += rays.weight[i]
        sums[rays.fold[i], square[i]] += rays.weight[i] * rays.error_m[i]
    out = np.zeros(folds)
    for p in range(len(pairs)):
        k, j = pairs[p]
        rest_weight, rest = np.zeros(many), np.zeros(many)
        for f in range(folds):
            if f not in (k, j):
                rest_weight += weights[f]
                rest += sums[f]
        inside = _higher(rest_weight, rest)
        out[k] += _confirmed(inside, weights[j], sums[j])
        out[j] += _confirmed(inside, weights[k], sums[k])
    return out


@njit(cache=True, nogil=True)
def crossings(origin: Float, point: Float, normal: Float, offset_m: float) -> Float:
    """(n, 3) metres: where rays cross the plane before their point; NaN where they do not."""
    out, n = np.full((len(origin), 3), np.nan), normal
    for i in range(len(origin)):
        x, y, z = origin[i, 0], origin[i, 1], origin[i, 2]
        dx, dy, dz = point[i, 0] - x, point[i, 1] - y, point[i, 2] - z
        along = dx * n[0] + dy * n[1] + dz * n[2]
        share = (offset_m - (x * n[0] + y * n[1] + z * n[2])) / along if along != 0.0 else np.inf
        if 0.0 < share < 1.0 and share**2 * (dx * dx + dy * dy + dz * dz) > NEAREST_M**2:
            out[i, 0], out[i, 1], out[i, 2] = x + share * dx, y + share * dy, z + share * dz
    return out


@njit(cache=True, nogil=True)
def _squares(where: Float, across: Float) -> tuple[Ints, int]:
    """(n,) the square of the plane at each crossing (n, 3), and how many there are; rays that do not cross the plane (NaN) are square 0."""
    crossed, (u, v) = np.flatnonzero(np.isfinite(where[:, 0])), across
    square, at = np.zeros(len(where), np.int64), np.zeros((len(crossed), 2), np.int64)
    if not len(crossed):
        return square, 1
    for k, i in enumerate(crossed):
        x, y, z = where[i, 0], where[i, 1], where[i, 2]
        at[k, 0] = np.floor((x * u[0] + y * u[1] + z * u[2]) / SIDE_M)
        at[k, 1] = np.floor((x * v[0] + y * v[1] + z * v[2]) / SIDE_M)
    row, column = at[:, 0] - at[:, 0].min(), at[:, 1] - at[:, 1].min()
    columns = column.max() + 1
    square[crossed] = 1 + row * columns + column
    return square, 1 + (row.max() + 1) * columns


@njit(cache=True, nogil=True)
def _higher(weight: Float, sums: Float) -> Mask:
    """(n,) squares at the higher of two levels of their means; none where there are no levels."""
    known = np.flatnonzero(weight > 0.0)
    low, high = two_levels(sums[known] / weight[known], weight[known])
    return np.asarray((weight > 0.0) & (sums > 0.5 * (low + high) * weight))  # False for all beside NaN.


@njit(cache=True, nogil=True)
def _confirmed(inside: Mask, weight: Float, sums: Float) -> float:
    """Sum of weights times squares that the squares `inside` (n,) explain of rays that did not choose them; negative where these contradict."""
    w = s = whole = total = 0.0
    for i in range(len(inside)):
        whole += weight[i]
        total += sums[i]
        if inside[i]:
            w += weight[i]
            s += sums[i]
    if not 0.0 < w < whole:
        return 0.0
    apart = s / w - (total - s) / (whole - w)
    return float(np.sign(apart) * apart**2 * w * (whole - w) / whole)
