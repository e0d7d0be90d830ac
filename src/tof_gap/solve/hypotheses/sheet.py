# SPDX-License-Identifier: Apache-2.0
"""The plane whose region delays light most: a pane of glass may stand anywhere between the cameras and the parts."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from tof_gap.solve.hypotheses.levels import levels

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from tof_core.arrays import Float, Ints, Mask

NORMALS = 24
"""Directions in which planes may face, evenly over half a sphere: some 30 degrees apart, of which `TURNS` find the rest."""
STEP_M = 0.1
"""Metres between parallel planes: a region seen from 1 m is then shifted by 5 cm between views that are 45 degrees apart, by one square."""
SIDE_M = 0.08
"""Side in metres of the squares of a plane: regions are decimetres wide."""
MOST_RAYS = 4000
"""Rays that planes are compared by: some ten in a square. Of 3000, half of the planes of seven panes were off by more than their search steps."""
NEAREST_M = 0.05
"""Metres before the camera within which a plane is part of it, as its cover glass is."""
TURNS = (0.15, 0.07, 0.03)
"""Radians by which the best plane is turned to find a better one, and a third of a metre for each of its shift."""
ROUNDS = 2
"""Rounds of turns of each size."""


@dataclass(frozen=True, slots=True, eq=False)
class Sheet:
    """The plane of points x with normal @ x = offset_m; normal (3,): of length 1, in the cell frame."""

    normal: Float
    offset_m: float

    @property
    def across(self) -> Float:
        """(2, 3) two directions in the plane."""
        return np.asarray(np.linalg.svd(self.normal[None])[2][1:])

    def crossed(self, origins: Float, points: Float) -> tuple[Mask, Float]:
        """(n,) which rays from origins (n, 3) or (3,) to points (n, 3) cross the plane before their point, and where (crossing rays, 3), metres."""
        way, before = points - origins, self.offset_m - origins @ self.normal
        with np.errstate(divide="ignore", invalid="ignore"):
            share = before / (way @ self.normal)
        seen = (share > 0.0) & (share < 1.0)
        seen[seen] = share[seen] ** 2 * np.einsum("ni,ni->n", way[seen], way[seen]) > NEAREST_M**2
        return seen, np.broadcast_to(origins, points.shape)[seen] + share[seen, None] * way[seen]

    def crossings(self, origins: Float, points: Float) -> Float:
        """(n, 3) metres: where rays cross the plane (`crossed`); NaN where they do not."""
        seen, where = self.crossed(origins, points)
        out = np.full(points.shape, np.nan)
        out[seen] = where
        return out

    def turned(self, about: Float, turn: Float, shift_m: float) -> Sheet:
        """The plane turned by a small rotation vector (3,) about the point `about` (3,), and shifted along its normal."""
        normal = self.normal + np.cross(turn, self.normal)
        normal /= np.linalg.norm(normal)
        return Sheet(normal, float(about @ normal) + shift_m)


@dataclass(frozen=True, slots=True, eq=False)
class Rays:
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


def sheets(rays: Rays, folds: Ints) -> dict[int, Sheet]:
    """For each fold the plane that explains most by the rays of the others: the best of a coarse search, turned and shifted."""
    if not len(rays.fold):
        return {}
    rays, count = rays.some(), len(folds)
    rays = replace(rays, fold=np.searchsorted(folds, rays.fold))  # By their places from here on.
    pairs, tried = list(combinations(range(count), 2)), list(_tried(rays))
    scores = np.array([_explained(rays, sheet, count, pairs) for sheet in tried]).reshape(-1, count)
    return {int(fold): _refined(rays, tried[int(np.argmax(scores[:, k]))], count, k) for k, fold in enumerate(folds)}


def _tried(rays: Rays) -> Iterator[Sheet]:
    """Planes `STEP_M` apart in `NORMALS` directions (a spiral over half a sphere) between the origins and the points."""
    at = (np.arange(NORMALS) + 0.5) / NORMALS
    height, turn = 1.0 - at, np.pi * (1.0 + np.sqrt(5.0)) * np.arange(NORMALS)
    radius = np.sqrt(1.0 - height**2)
    for normal in np.stack([radius * np.cos(turn), radius * np.sin(turn), height], axis=1):
        heights = np.concatenate([rays.origin @ normal, rays.point @ normal])
        yield from (Sheet(normal, float(at)) for at in np.arange(heights.min() + STEP_M, heights.max(), STEP_M))


def _explained(rays: Rays, sheet: Sheet, folds: int, pairs: Sequence[tuple[int, int]]) -> Float:
    """(folds,) what a region of the plane explains of the errors of all other folds, each as the rest of them tell; 0 without a rest.

    The region is the squares at the higher of two levels. By the same views, squares of few rays would explain noise, and those of a plane
    close to the cameras, which no two views share, anything. pairs: the folds that the rest is without.
    """
    square, many = _squares(rays, sheet)
    which = rays.fold * many + square
    weight, sums = (np.bincount(which, x, folds * many).reshape(-1, many) for x in (rays.weight, rays.weight * rays.error_m))
    out = np.zeros(folds)
    for k, j in pairs:
        rest = [fold for fold in range(folds) if fold not in (k, j)]
        inside = _higher(weight[rest].sum(axis=0), sums[rest].sum(axis=0))
        out[k] += _confirmed(inside, weight[j], sums[j])
        out[j] += _confirmed(inside, weight[k], sums[k])
    return out


def _squares(rays: Rays, sheet: Sheet) -> tuple[Ints, int]:
    """(n,) the square of the plane that each ray crosses, and how many there are; rays that do not cross the plane are one square more."""
    seen, crossing = sheet.crossed(rays.origin, rays.point)
    square = np.zeros(len(seen), np.int64)
    if not len(crossing):
        return square, 1
    at = np.floor(crossing @ sheet.across.T / SIDE_M).astype(np.int64)
    at -= at.min(axis=0)
    rows, columns = at.max(axis=0) + 1
    square[seen] = 1 + at[:, 0] * columns + at[:, 1]
    return square, 1 + int(rows * columns)


def _higher(weight: Float, sums: Float) -> Mask:
    """(n,) squares at the higher of two levels of their means; none where there are no levels."""
    known = weight > 0
    found = levels(sums[known] / weight[known], weight[known])
    return np.zeros(len(known), bool) if found is None else known & (sums > found.middle * weight)


def _confirmed(inside: Mask, weight: Float, sums: Float) -> float:
    """Sum of weights times squares that the squares `inside` (n,) explain of rays that did not choose them; negative where these contradict."""
    w, s, whole, total = weight[inside].sum(), sums[inside].sum(), weight.sum(), sums.sum()
    if not 0.0 < w < whole:
        return 0.0
    apart = s / w - (total - s) / (whole - w)
    return float(np.sign(apart) * apart**2 * w * (whole - w) / whole)


def _refined(rays: Rays, sheet: Sheet, folds: int, k: int) -> Sheet:
    """The plane, turned about the middle of its crossings and shifted while that explains more by the rays of all folds but number `k`."""
    pairs = [(k, j) for j in range(folds) if j != k]
    best = float(_explained(rays, sheet, folds, pairs)[k])
    for turn in np.repeat(TURNS, ROUNDS):
        _, crossing = sheet.crossed(rays.origin, rays.point)
        if not len(crossing):
            return sheet
        about = crossing.mean(axis=0)
        moves = [(sign * turn * axis, 0.0) for axis in sheet.across for sign in (1.0, -1.0)] + [
            (np.zeros(3), sign * turn / 3.0) for sign in (1.0, -1.0)
        ]
        others = [sheet.turned(about, *move) for move in moves]
        scores = [float(_explained(rays, other, folds, pairs)[k]) for other in others]
        if max(scores) > best:
            best, sheet = max(scores), others[int(np.argmax(scores))]
    return sheet
