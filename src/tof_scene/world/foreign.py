# SPDX-License-Identifier: Apache-2.0
"""Foreign objects, measured before the CAD by several views at the same place, or by a single view."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy import ndimage
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from tof_core.stats import robust_std
from tof_scene.world.contradiction import EIGHT
from tof_scene.world.lying import most_end_in_a_step

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Float, Ints, Mask
    from tof_scene.world.limits import WorldLimits
    from tof_scene.world.seen import Seen

POINTS = 4000
"""Most points of a view that are used."""
CAD_POINTS = 60_000
"""Most points of the rendered CAD to which distances are computed."""
TRIM = 0.02
"""Share of an object's points that its box leaves out at each side."""
SEEN_THROUGH = 0.1
"""Share of the points contradicted by other views from which a cluster of one view is no side of a standing object."""
AMONG = 0.5
"""Share of the pixels of a cluster of one view beside or among those of a standing object, from which the cluster is noise of that object."""
INSIDE = 0.3
"""Least share of inner pixels of an object measured by one view: an arm has two thirds; mixed pixels along edges have at most a fifth."""
ONE_PART, WHOLE_PART = 0.95, 0.8
"""Least share of what one view measures before the CAD on one part, and of that part's pixels, from which it is the part itself: an object
before a part overlaps others, too."""
SIDE = 0.5
"""Largest distance of a side measured by one view from the object measured by several views, as a share of the object's diagonal."""

SAME_PLACE = 0.5
"""Distance of two boxes' centres, as a share of the smaller one's size, below which two views saw one object."""
LEAST_WRAP_M = 0.3
"""Unambiguous range in metres at 500 MHz, above any camera's frequency: the least jump by a wrapped phase."""
WRAP_SPREAD = 0.05
"""Robust standard deviation of the jumps of one object, as a share of their median, below which the jumps are equal."""


@dataclass(frozen=True, slots=True, eq=False)
class Foreign:
    """An object that is not in the CAD.

    centre_m, size_m (3,): of the box, along the axes of the cell, of the visible points; views: indices of the views that show it; pixels:
    their number over these views; moves: other views measure surfaces behind it, as with a hand; points (n, 3): measured points in the
    cell; clearance (n,): their distance to the CAD, metres.
    """

    centre_m: Float
    size_m: Float
    views: tuple[int, ...]
    pixels: int
    moves: bool
    points: Float
    clearance: Float


@dataclass(frozen=True, slots=True, eq=False)
class _Cloud:
    """Points (n, 3) measured before the CAD.

    view (n,): of each point; pixel (n, 2): row and column in that view; jump (n,): distance before the CAD along z, metres; static (n,):
    other views measured the point, too; through (n,): other views measured surfaces behind it; step (views,): every step-th pixel is used.
    """

    points: Float
    view: Ints
    pixel: Ints
    jump: Float
    static: Mask
    through: Mask
    step: Ints


def foreign_objects(views: Sequence[Seen], before: Sequence[Mask], measured: Sequence[Float], limits: WorldLimits) -> tuple[Foreign, ...]:
    """Objects of the session, those of several views first.

    A cluster of a single view beside an object of several views, which no view contradicts, belongs to that object: it is a side
    that other views do not see.

    Args:
        views: views of the session.
        before: (H, W) pixels of each view that were measured before the CAD.
        measured: (H, W) depth of each view without the sensor's errors, metres.
        limits: least size of an object.
    """
    cloud = _cloud(views, before, measured, limits)
    if not len(cloud.points):
        return ()
    clearance, voxel = _clearance(views, cloud.points), limits.voxel_mm * 1e-3
    standing: list[Ints] = []
    single: list[Ints] = []

    def shown_by(mine: Ints) -> list[tuple[Seen, Float, Mask]]:
        return [(views[v], measured[v], _pixels(cloud, mine, v, before[v])) for v in _views(cloud, mine, limits.object_view_px)]

    def no_bias(mine: Ints) -> bool:
        """Whether a fifth of the points is farther before the CAD than any sensor bias, or they end in a step, which a bias does not, in most views.

        An object that leans on a part approaches the CAD gradually. A view from the side sees a flat object as a strip far before what lies
        behind: there it is far before the CAD, without one height.
        """
        most = limits.bias_most_mm * 1e-3
        return _stands_out(cloud.jump[mine], limits.bias_most_mm) or most_end_in_a_step(shown_by(mine), on_a_part=False, beyond_m=most)

    for mine in _clusters(cloud.points, cloud.static, voxel):
        shown = _views(cloud, mine, limits.object_view_px)
        large_enough = len(shown) > 1 and cloud.step[cloud.view[mine]].sum() >= limits.object_px
        if large_enough and (
            _stands_out(clearance[mine], limits.stands_out_mm)
            or (_stands_out(clearance[mine], limits.lies_mm) and most_end_in_a_step(shown_by(mine), on_a_part=True))
        ):
            standing.append(mine)
    for number, seen in enumerate(views):
        alone = ~cloud.static & (cloud.view == number)
        least = max(limits.object_px, limits.moving_share * seen.depth.size)
        large = (mine for mine in _clusters(cloud.points, alone, voxel) if len(mine) * cloud.step[number] >= least)
        standing_out = (mine for mine in large if _stands_out(clearance[mine], limits.stands_out_mm) and not _wrapped(cloud.jump[mine]))
        for mine in standing_out:
            seen_px = _pixels(cloud, mine, number, before[number])
            if _inside(seen_px) >= INSIDE and not _is_a_part(seen, seen_px):
                single.append(mine)
    joined, single = _joined(cloud, standing, single, 2 * voxel, limits.rim_px)
    objects = [_object(cloud, mine, clearance, _views(cloud, mine, limits.object_view_px), moves=False) for mine in joined if no_bias(mine)]
    for mine in _at_one_place(cloud, list(filter(no_bias, single))):
        moves = bool(cloud.through[mine].mean() > 0.5)
        objects.append(_object(cloud, mine, clearance, _views(cloud, mine, 1), moves=moves))
    return tuple(objects)


def _at_one_place(cloud: _Cloud, single: Sequence[Ints]) -> list[Ints]:
    """Clusters of one view each, joined where their boxes cover each other by half along every axis: one object that stood there for some views."""
    boxes = [_box(cloud.points[mine]) for mine in single]
    same = np.array(
        [[bool((np.abs(c - d) < SAME_PLACE * np.minimum(s, t)).all()) for d, t in boxes] for c, s in boxes],
        bool,
    ).reshape(len(boxes), len(boxes))
    count, group = connected_components(csr_array(same), directed=False)
    return [np.concatenate([mine for mine, g in zip(single, group, strict=True) if g == k]) for k in range(count)]


def _joined(cloud: _Cloud, standing: Sequence[Ints], single: Sequence[Ints], reach: float, rim_px: int) -> tuple[list[Ints], list[Ints]]:
    """Clusters of several views, joined with each other via touching clusters of one view, and the remaining clusters of one view."""
    of_several = np.concatenate(standing) if standing else np.zeros(0, np.int64)
    still = [
        k for k, mine in enumerate(single) if cloud.through[mine].mean() < SEEN_THROUGH or _among(cloud, mine, of_several, rim_px) > AMONG
    ]
    every = [*standing, *(single[k] for k in still)]
    trees = [cKDTree(cloud.points[mine]) for mine in every]
    far = [
        max(reach, SIDE * float(np.linalg.norm(_box(cloud.points[mine])[1]))) if k < len(standing) else reach
        for k, mine in enumerate(every)
    ]
    touch = np.array(
        [[bool(a.count_neighbors(b, far[i] if j >= len(standing) else reach)) for j, b in enumerate(trees)] for i, a in enumerate(trees)],
        bool,
    ).reshape(len(every), len(every))
    _, group = connected_components(csr_array(touch), directed=False)
    mine_of = [np.flatnonzero(group == g) for g in dict.fromkeys(group[: len(standing)].tolist())]
    taken = {still[k - len(standing)] for members in mine_of for k in members.tolist() if k >= len(standing)}
    return [np.concatenate([every[k] for k in m]) for m in mine_of], [mine for k, mine in enumerate(single) if k not in taken]


def _among(cloud: _Cloud, mine: Ints, others: Ints, rim_px: int) -> float:
    """Share of the points `mine`, all of one view, with a point of `others` within `rim_px` pixels in that view."""
    number = cloud.view[mine[0]]
    beside = others[cloud.view[others] == number]
    if not len(beside):
        return 0.0
    reach = rim_px * float(np.sqrt(cloud.step[number])) + 0.5  # only every step-th pixel is a point
    distance, _ = cKDTree(cloud.pixel[beside]).query(cloud.pixel[mine], distance_upper_bound=reach)
    return float(np.isfinite(distance).mean())


def _cloud(views: Sequence[Seen], before: Sequence[Mask], measured: Sequence[Float], limits: WorldLimits) -> _Cloud:
    """All points before the CAD, each compared with the depth in the other views at its place."""
    points, view, pixel, jump, step = [], [], [], [], []
    for number, (seen, near, z) in enumerate(zip(views, before, measured, strict=True)):
        at = near & np.isfinite(z)
        found = seen.points(at, z)
        every = max(1, len(found) // POINTS)
        points.append(found[::every])
        view.append(np.full(len(found[::every]), number))
        pixel.append(np.argwhere(at)[::every])
        jump.append((seen.cad - z)[at][::every])
        step.append(every)
    every_point, of_view = np.concatenate(points), np.concatenate(view)
    agree, through = np.zeros((2, len(every_point)), int)
    margin = limits.agree_mm * 1e-3
    for number, (seen, near, z) in enumerate(zip(views, before, measured, strict=True)):
        row, column, depth, inside = seen.pixels_of(every_point)
        ahead = z[row, column] - depth
        other = inside & (of_view != number)
        agree += other & near[row, column] & (np.abs(ahead) < margin)
        through += other & (ahead > margin)
    return _Cloud(
        every_point, of_view, np.concatenate(pixel), np.concatenate(jump), (agree > 0) & (agree >= through), through > agree, np.array(step)
    )


def _clusters(points: Float, where: Mask, voxel: float) -> list[Ints]:
    """Indices of the points of each cluster of voxels; one empty voxel does not separate clusters."""
    index = np.flatnonzero(where)
    if not len(index):
        return []
    cell = np.floor(points[index] / voxel).astype(np.int64)
    cell -= cell.min(axis=0) - 1
    if np.prod(cell.max(axis=0) + 2.0) > 5e7:  # Points tens of metres apart are no object.
        return []
    grid = np.zeros(cell.max(axis=0) + 2, bool)
    grid[tuple(cell.T)] = True
    number, count = ndimage.label(ndimage.binary_dilation(grid, np.ones((2, 2, 2), bool)), np.ones((3, 3, 3), bool))
    mine = number[tuple(cell.T)]
    return [index[mine == k] for k in range(1, count + 1)]


def _clearance(views: Sequence[Seen], points: Float) -> Float:
    """(n,) distance of points (n, 3) from the nearest point of the CAD visible in any view, metres."""
    drawn = [np.isfinite(v.cad) for v in views]
    counts = [int(d.sum()) for d in drawn]
    every, before = max(1, sum(counts) // CAD_POINTS), np.cumsum([0, *counts[:-1]])
    # Every n-th point of all views, copied: a slice would keep all points of its view, half a gigabyte in a long session.
    cad = [v.points(d, v.cad.astype(float))[-first % every :: every].copy() for v, d, first in zip(views, drawn, before, strict=True)]
    distance, _ = cKDTree(np.concatenate(cad)).query(points)
    return np.asarray(distance)


def _stands_out(clearance: Float, least_mm: float) -> bool:
    """Whether more than a fifth of an object's points are farther from the CAD, or before it, than `least_mm`."""
    return bool(np.quantile(clearance, 0.8) > least_mm * 1e-3)


def _pixels(cloud: _Cloud, mine: Ints, number: int, before: Mask) -> Mask:
    """(H, W) pixels of those patches before the CAD in one view that contain points of the object."""
    seed = np.zeros(before.shape, bool)
    seed[tuple(cloud.pixel[mine[cloud.view[mine] == number]].T)] = True
    return np.asarray(ndimage.binary_propagation(seed, structure=EIGHT, mask=before))


def _inside(object_px: Mask) -> float:
    """Share of the pixels of a mask (H, W) whose eight neighbours are in the mask, too."""
    return float(ndimage.binary_erosion(object_px, EIGHT).sum() / max(object_px.sum(), 1))


def _is_a_part(seen: Seen, object_px: Mask) -> bool:
    """Whether the pixels of a mask (H, W) are those of one part, all that the view sees of it: a part that is near and bright may be off."""
    part, count = np.unique(seen.part[object_px], return_counts=True)
    most = int(np.argmax(count))
    return bool(count[most] > ONE_PART * count.sum() and count[most] > WHOLE_PART * np.count_nonzero(seen.part == part[most]))


def _wrapped(jump: Float) -> bool:
    """Whether the jumps (n,) of one view are large and equal, which indicates a wrapped phase."""
    size = float(np.median(jump))
    return size > LEAST_WRAP_M and robust_std(jump) < WRAP_SPREAD * size


def _views(cloud: _Cloud, mine: Ints, least: int) -> tuple[int, ...]:
    count = np.bincount(cloud.view[mine], minlength=len(cloud.step)) * cloud.step
    return tuple(int(v) for v in np.flatnonzero(count >= least))


def _object(cloud: _Cloud, mine: Ints, clearance: Float, views: tuple[int, ...], *, moves: bool) -> Foreign:
    points = cloud.points[mine]
    return Foreign(*_box(points), views, int(cloud.step[cloud.view[mine]].sum()), moves, points, clearance[mine])


def _box(points: Float) -> tuple[Float, Float]:
    """Centre and size (3,) of the box around points (n, 3), along the axes of the cell."""
    low, high = np.quantile(points, [TRIM, 1 - TRIM], axis=0)
    return 0.5 * (low + high), high - low
