# SPDX-License-Identifier: Apache-2.0
"""One delay of all light into a region of the cell, as a pane of glass before it makes: an error of no named effect.

The region may end within a part, where no deviation of a part and no material ends. It is found from the residuals, in turn with the
poses that they determine (two levels: T. Chan, L. Vese, Active contours without edges, IEEE Trans. Image Processing 10, 2001).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse import coo_array, eye_array
from scipy.spatial import cKDTree

from tof_gap.solve.candidate import Candidate
from tof_gap.solve.free import UNKNOWN
from tof_gap.solve.nameless import Nameless
from tof_sensor.geometry import cell_points, pose_columns

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from scipy.sparse import csr_array

    from tof_core.arrays import Float, Ints, Mask
    from tof_gap.seen.residual import ViewEvidence

REGION = "region"
LEAST_M = 5e-4
"""Least delay in metres: half of the millimetre from which an effect counts."""
ROUNDS = 6
"""Rounds of poses and region: in sessions with a pane, the region no longer changes after the fourth."""
SHARES = (0.02, 0.6)
"""Least and largest share of the pixels' weight in the region; a constant over more than half is an offset, whose complement is the region."""
SPACINGS = 1.5
"""Side of a cube of the cell, in spacings of the drawn pixels: less leaves cubes without pixels."""
AROUND = 1.8
"""Sides of a cube within which the centres of those lie that touch it, 26 and itself."""
OTHER_M = 1e-3
"""Metres by which errors of other effects differ between pixels, so that pixels of low noise do not decide alone."""
SHARED = 20.0
"""Pixels that share one error of other effects, by which pixels weigh less against the poses' prior."""
TOUCHING = 1.0
"""Chi-square that two touching cubes of different levels cost: values of 0.3 to 3 find the same regions in five sessions with a pane."""
SWEEPS = 4
"""Sweeps over all cubes: a change travels by one cube a sweep, and specks of noise are smaller than four."""
POSE_SD = np.repeat([1e-2, np.radians(0.5)], 3)
"""Standard deviation (metres, radians) of a view's pose about the present solution: wide, since a region taken for a pose is not found."""
CLIP_M = 2e-2
"""Largest error in metres that counts."""


@dataclass(frozen=True, slots=True, eq=False)
class Cells:
    """Cubes of the cell of `side` metres from the corner `low` (3,), by their numbers in a grid of `shape`; `inside` of them are the region."""

    side: float
    low: Float
    shape: tuple[int, int, int]
    inside: Ints

    def corners(self, points: Float) -> Float:
        """(n, 3) cubes of points (n, 3) in metres, counted along the grid's axes; whole numbers, outside of the grid too."""
        return np.asarray(np.floor(points / self.side) - self.low)

    def contain(self, points: Float) -> Mask:
        """(n,) whether points (n, 3) in metres lie in the region."""
        at = self.corners(np.nan_to_num(points, nan=np.inf, posinf=1e6))
        within = np.all((at >= 0) & (at < self.shape), axis=1)
        number = np.ravel_multi_index(tuple(np.where(within[:, None], at, 0).astype(np.int64).T), self.shape)
        return np.asarray(within & np.isin(number, self.inside))


@dataclass(frozen=True, slots=True, eq=False)
class Region(Nameless):
    """A constant delay along the ray in a region of the cell.

    cells: by each view's stamp, the region by the views of all other folds, so that the held-out score of its column is not biased. The
    column is zero elsewhere, and its mean is not: light that does not pass through the region is not late.
    """

    cells: Mapping[int, Cells]
    means: tuple[float, ...] = (0.0,)
    quantity: str = REGION

    def along_ray(self, view: ViewEvidence, at: Ints) -> Float:
        """(n, 1) one within the region."""
        points = cell_points(view.frame).reshape(-1, 3)[at]
        return self.cells[view.view.stamp_ns].contain(points).astype(float)[:, None]


def regions(views: Sequence[ViewEvidence], folds: Ints) -> list[Candidate]:
    """The region whose delay explains most, found for each fold from the views of the others; none where a fold shows no delay."""
    drawn = [_drawn(view) for view in views]
    if not any(len(d.residual) for d in drawn):
        return []
    grid = _grid(views, drawn)
    found: dict[int, Cells] = {}
    for fold in np.unique(folds):
        inside = _delayed([d for d, f in zip(drawn, folds, strict=True) if f != fold], grid)
        if inside is None:
            return []
        found |= {v.view.stamp_ns: inside for v, f in zip(views, folds, strict=True) if f == fold}
    return [Candidate(UNKNOWN, None, REGION, Region(found))]


@dataclass(frozen=True, slots=True, eq=False)
class _Drawn:
    """Drawn pixels of a view: residual (n,) and weight (n,) of z, z per metre along the ray (n,), pose columns (n, 6), points (n, 3)."""

    residual: Float
    weight: Float
    per_metre: Float
    pose: Float
    points: Float


def _drawn(view: ViewEvidence) -> _Drawn:
    at, frame = view.pixels, view.frame
    return _Drawn(
        view.residual.ravel()[at].astype(float),
        1.0 / (view.fit_sigma.ravel()[at].astype(float) ** 2 + OTHER_M**2),
        1.0 / frame.length.ravel()[at],
        pose_columns(frame.take(at))[0],
        cell_points(frame).reshape(-1, 3)[at],
    )


def _grid(views: Sequence[ViewEvidence], drawn: Sequence[_Drawn]) -> Cells:
    """Cubes over all points, by the median spacing of drawn pixels; none of them inside."""
    spacing = [
        v.frame.camera.pixel_angle * float(np.median(v.frame.radial.ravel()[v.pixels])) * np.sqrt(v.smooth.sum() / len(v.pixels))
        for v in views
        if len(v.pixels)
    ]
    side = SPACINGS * float(np.median(spacing))
    at = np.floor(np.concatenate([d.points for d in drawn]) / side)
    low = at.min(axis=0)
    x, y, z = (int(n) for n in at.max(axis=0) - low + 1)
    return Cells(side, low, (x, y, z), np.zeros(0, np.int64))


def _delayed(drawn: Sequence[_Drawn], grid: Cells) -> Cells | None:
    """The region by these views; None without pixels, and where its delay is less than `LEAST_M`."""
    if not any(len(d.residual) for d in drawn):
        return None
    at = grid.corners(np.concatenate([d.points for d in drawn])).astype(np.int64)
    numbers, cube = np.unique(np.ravel_multi_index(tuple(at.T), grid.shape), return_inverse=True)
    corners = np.stack(np.unravel_index(numbers, grid.shape), axis=1)
    pairs = cKDTree(corners).query_pairs(AROUND, output_type="ndarray")
    touching = coo_array((np.ones(len(pairs)), pairs.T), (len(numbers), len(numbers)))
    around = (touching + touching.T + eye_array(len(numbers))).tocsr()
    of_view = np.split(cube, np.cumsum([len(d.residual) for d in drawn])[:-1])
    along = np.concatenate([d.weight * d.per_metre**2 for d in drawn])
    weight = _sums(along, cube, len(numbers))
    inside, delay_m = np.zeros(len(numbers), bool), 0.0
    for _ in range(ROUNDS):
        left, delay_m = _posed(drawn, [inside[c] for c in of_view])
        error = np.clip(np.concatenate([e / d.per_metre for e, d in zip(left, drawn, strict=True)]), -CLIP_M, CLIP_M)
        inside = _segmented(_sums(along * error, cube, len(numbers)), weight, around)
    return None if delay_m < LEAST_M else Cells(grid.side, grid.low, grid.shape, numbers[inside])


def _sums(values: Float, cube: Ints, cubes: int) -> Float:
    """(cubes,) sums of values (n,) by cube (n,)."""
    return np.asarray(np.bincount(cube, values, cubes), float)


def _posed(drawn: Sequence[_Drawn], inside: Sequence[Mask]) -> tuple[list[Float], float]:
    """Residuals (n,) of each view less those of its pose, and the delay in metres, fitted together: poses by view, the delay over all."""
    prior = np.diag(POSE_SD**-2.0)
    solved, information, right = [], 0.0, 0.0
    for d, within in zip(drawn, inside, strict=True):
        weighted = d.pose * (d.weight / SHARED)[:, None]
        inverse = np.linalg.inv(d.pose.T @ weighted + prior)
        column = within * d.per_metre
        of_column, of_residual = (inverse @ (weighted.T @ x) for x in (column, d.residual))
        information += float(d.weight @ column**2 / SHARED - (weighted.T @ column) @ of_column)
        right += float(d.weight @ (column * d.residual) / SHARED - (weighted.T @ column) @ of_residual)
        solved.append((of_column, of_residual))
    delay_m = right / information if information > 0 else 0.0
    return [d.residual - d.pose @ (r - c * delay_m) for d, (c, r) in zip(drawn, solved, strict=True)], delay_m


def _segmented(sums: Float, weight: Float, around: csr_array) -> Mask:
    """(n,) cubes at the higher of two levels; sums (n,): of weighted errors; `around` (n, n): which cubes touch.

    The levels are those of means over neighbours. A cube then takes the level that its own mean and its neighbours' levels make likelier
    (iterated conditional modes: J. Besag, On the statistical analysis of dirty pictures, J. Royal Statistical Society B 48, 1986).
    """
    means, smoothed = sums / weight, (around @ sums) / (around @ weight)
    levels = _levels(smoothed, weight)
    if levels is None:
        return np.zeros(len(sums), bool)
    low, high = levels
    own = (means - 0.5 * (low + high)) * (high - low) * weight / SHARED
    inside = smoothed > 0.5 * (low + high)
    for _ in range(SWEEPS):
        inside = np.asarray(own + TOUCHING * (around @ (2.0 * inside - 1.0)) > 0)
    return np.asarray(inside)


def _levels(means: Float, weight: Float) -> tuple[float, float] | None:
    """Two levels of the means (n,): those of the split with the largest weighted variance between them (Otsu 1979); None without one."""
    order = np.argsort(means, kind="stable")
    below, sums = np.cumsum(weight[order]), np.cumsum(weight[order] * means[order])
    total, whole = below[-1], sums[-1]
    share = 1.0 - below[:-1] / total
    allowed = (share > SHARES[0]) & (share < SHARES[1])
    if not allowed.any():
        return None
    between = (sums[:-1] * total - whole * below[:-1]) ** 2 / (below[:-1] * (total - below[:-1]))
    at = int(np.argmax(np.where(allowed, between, -1.0)))
    return float(sums[at] / below[at]), float((whole - sums[at]) / (total - below[at]))
