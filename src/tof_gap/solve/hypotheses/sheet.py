# SPDX-License-Identifier: Apache-2.0
"""The plane whose region delays light most: a pane of glass may stand anywhere between the cameras and the parts."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from tof_gap.solve.hypotheses.sheet_score import Rays, crossings, explained

if TYPE_CHECKING:
    from collections.abc import Iterator

    from tof_core.arrays import Float, Ints

NORMALS = 24
"""Directions in which planes may face, evenly over half a sphere: some 30 degrees apart, of which `TURNS` find the rest."""
STEP_M = 0.1
"""Metres between parallel planes: a region seen from 1 m is then shifted by 5 cm between views that are 45 degrees apart, by one square."""
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

    @property
    def axes(self) -> tuple[Float, float, Float]:
        """Normal (3,), offset in metres and `across` (2, 3), as kernels take them."""
        return self.normal, self.offset_m, self.across

    def crossings(self, origins: Float, points: Float) -> Float:
        """(n, 3) metres: where rays from origins (n, 3) or (3,) to points (n, 3) cross the plane before their point; NaN where they do not."""
        # One origin for all rays stays read-only where it is broadcast, and a kernel is compiled again for read-only arrays.
        return np.asarray(
            crossings(np.require(np.broadcast_to(origins, points.shape), np.float64, ["C", "W"]), points, self.normal, self.offset_m)
        )

    def turned(self, about: Float, turn: Float, shift_m: float) -> Sheet:
        """The plane turned by a small rotation vector (3,) about the point `about` (3,), and shifted along its normal."""
        normal = self.normal + np.cross(turn, self.normal)
        normal /= np.linalg.norm(normal)
        return Sheet(normal, float(about @ normal) + shift_m)


def sheets(rays: Rays, folds: Ints) -> dict[int, Sheet]:
    """For each fold the plane that explains most by the rays of the others: the best of a coarse search, turned and shifted."""
    if not len(rays.fold):
        return {}
    rays, count = rays.some(), len(folds)
    rays = rays._replace(fold=np.searchsorted(folds, rays.fold))  # By their places from here on.
    pairs, tried = np.array(list(combinations(range(count), 2))).reshape(-1, 2), list(_tried(rays))
    scores = np.array([explained(rays, *sheet.axes, pairs, count) for sheet in tried]).reshape(-1, count)
    return {int(fold): _refined(rays, tried[int(np.argmax(scores[:, k]))], count, k) for k, fold in enumerate(folds)}


def _tried(rays: Rays) -> Iterator[Sheet]:
    """Planes `STEP_M` apart in `NORMALS` directions (a spiral over half a sphere) between the origins and the points."""
    at = (np.arange(NORMALS) + 0.5) / NORMALS
    height, turn = 1.0 - at, np.pi * (1.0 + np.sqrt(5.0)) * np.arange(NORMALS)
    radius = np.sqrt(1.0 - height**2)
    for normal in np.stack([radius * np.cos(turn), radius * np.sin(turn), height], axis=1):
        heights = np.concatenate([rays.origin @ normal, rays.point @ normal])
        yield from (Sheet(normal, float(at)) for at in np.arange(heights.min() + STEP_M, heights.max(), STEP_M))


def _refined(rays: Rays, sheet: Sheet, folds: int, k: int) -> Sheet:
    """The plane, turned about the middle of its crossings and shifted while that explains more by the rays of all folds but number `k`."""
    pairs = np.array([(k, j) for j in range(folds) if j != k]).reshape(-1, 2)
    best = float(explained(rays, *sheet.axes, pairs, folds)[k])
    for turn in np.repeat(TURNS, ROUNDS):
        crossing = sheet.crossings(rays.origin, rays.point)
        crossed = np.isfinite(crossing[:, 0])
        if not crossed.any():
            return sheet
        about = crossing[crossed].mean(axis=0)
        moves = [(sign * turn * axis, 0.0) for axis in sheet.across for sign in (1.0, -1.0)] + [
            (np.zeros(3), sign * turn / 3.0) for sign in (1.0, -1.0)
        ]
        others = [sheet.turned(about, *move) for move in moves]
        scores = [float(explained(rays, *other.axes, pairs, folds)[k]) for other in others]
        if max(scores) > best:
            best, sheet = max(scores), others[int(np.argmax(scores))]
    return sheet
