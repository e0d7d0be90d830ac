# SPDX-License-Identifier: Apache-2.0
"""One delay of all light into a region of the cell, as a pane of glass before it makes: an error of no named effect.

The region may end within a part, where no deviation of a part and no material ends. It lies on the surfaces, or on a plane between them and
the cameras. It is found from the residuals, in turn with the poses that they determine.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from tof_gap.solve.hypotheses.candidate import Candidate
from tof_gap.solve.hypotheses.cubes import SHARED, Cells, at_higher_level, touching
from tof_gap.solve.hypotheses.free import UNKNOWN
from tof_gap.solve.hypotheses.nameless import Nameless
from tof_gap.solve.hypotheses.sheet import sheets
from tof_gap.solve.hypotheses.sheet_score import Rays
from tof_sensor.geometry import cell_points, pose_columns

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from tof_core.arrays import Float, Ints, Mask
    from tof_gap.seen.evidence.view import ViewEvidence
    from tof_gap.solve.hypotheses.sheet import Sheet

REGION = "region"
LEAST_M = 5e-4
"""Least delay in metres: half of the millimetre from which an effect counts."""
ROUNDS = 6
"""Rounds of poses and region: in sessions with a pane, the region no longer changes after the fourth."""
SPACINGS = 1.5
"""Side of a cube of the cell, in spacings of the drawn pixels: less leaves cubes without pixels."""
OTHER_M = 1e-3
"""Metres by which errors of other effects differ between pixels, so that pixels of low noise do not decide alone."""
POSE_SD = np.repeat([1e-2, np.radians(0.5)], 3)
"""Standard deviation (metres, radians) of a view's pose about the present solution: wide, since a region taken for a pose is not found."""
CLIP_M = 2e-2
"""Largest error in metres that counts."""


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
        origin, points = view.rendering.T_cell_camera[:3, 3], cell_points(view.frame).reshape(-1, 3)[at]
        return self.cells[view.view.stamp_ns].hold(origin, points).astype(float)[:, None]


def regions(views: Sequence[ViewEvidence], folds: Ints) -> list[Candidate]:
    """The region whose delay explains most, found for each fold from the views of the others; none where a fold shows no delay.

    A region of a plane before the surfaces delays light into one of the surfaces as well, though its edges differ by view: without that,
    no plane is searched for.
    """
    drawn, every = [_drawn(view) for view in views], np.unique(folds)
    if not any(len(d.residual) for d in drawn):
        return []
    side = _side(views)
    others = {int(fold): [d for d, f in zip(drawn, folds, strict=True) if f != fold] for fold in every}
    found = {fold: late for fold, rest in others.items() if (late := _delayed(rest, side, None)) is not None}
    if len(found) < len(every):
        return []
    for fold, sheet in _planes(drawn, folds).items():
        late = _delayed(others[fold], side, sheet)
        if late is not None and late.explained > found[fold].explained:
            found[fold] = late
    return [Candidate(UNKNOWN, None, REGION, Region({v.view.stamp_ns: found[int(f)].cells for v, f in zip(views, folds, strict=True)}))]


@dataclass(frozen=True, slots=True, eq=False)
class _Drawn:
    """Drawn pixels of a view: residual (n,) and weight (n,) of z, z per metre along the ray (n,), pose columns (n, 6), points (n, 3), origin (3,).

    weighted: (n, 6) pose columns by weight, where pixels share errors; cov (6, 6) of the pose; of_residual (6,) the pose without a region.
    """

    residual: Float
    weight: Float
    per_metre: Float
    pose: Float
    points: Float
    origin: Float
    weighted: Float
    cov: Float
    of_residual: Float

    @property
    def along(self) -> Float:
        """(n,) weight of errors along the ray."""
        return self.weight * self.per_metre**2

    def errors(self, pose: Float) -> Float:
        """(n,) errors along the ray in metres, less those of a pose (6,)."""
        return np.clip((self.residual - self.pose @ pose) / self.per_metre, -CLIP_M, CLIP_M)


class _Late(NamedTuple):
    """A region of late light, and the chi-square that its delay explains beside the poses."""

    cells: Cells
    explained: float


class _Posed(NamedTuple):
    """Errors (n,) along the ray in metres of each view less those of its pose; the delay in metres, and the chi-square that it explains."""

    errors: list[Float]
    delay_m: float
    explained: float


def _drawn(view: ViewEvidence) -> _Drawn:
    at, frame = view.pixels, view.frame
    return _with_pose(
        view.residual.ravel()[at].astype(float),
        1.0 / (view.fit_sigma.ravel()[at].astype(float) ** 2 + OTHER_M**2),
        1.0 / frame.length.ravel()[at],
        pose_columns(frame.take(at))[0],
        cell_points(frame).reshape(-1, 3)[at],
        np.asarray(view.rendering.T_cell_camera[:3, 3]),
    )


def _with_pose(residual: Float, weight: Float, per_metre: Float, pose: Float, points: Float, origin: Float) -> _Drawn:
    """What each round needs of the pose, which no region changes, computed once."""
    weighted = pose * (weight / SHARED)[:, None]
    cov = np.asarray(np.linalg.inv(pose.T @ weighted + np.diag(POSE_SD**-2.0)), float)
    return _Drawn(residual, weight, per_metre, pose, points, origin, weighted, cov, cov @ (weighted.T @ residual))


def _side(views: Sequence[ViewEvidence]) -> float:
    """Metres: side of a cube, by the median spacing of drawn pixels."""
    spacing = [
        v.frame.camera.pixel_angle * float(np.median(v.frame.radial.ravel()[v.pixels])) * np.sqrt(v.smooth.sum() / len(v.pixels))
        for v in views
        if len(v.pixels)
    ]
    return SPACINGS * float(np.median(spacing))


def _planes(drawn: Sequence[_Drawn], folds: Ints) -> dict[int, Sheet]:
    """For each fold, the plane between cameras and surfaces whose region explains most by the views of the others."""
    rays = Rays(
        origin=np.concatenate([np.broadcast_to(d.origin, d.points.shape) for d in drawn]),
        point=np.concatenate([d.points for d in drawn]),
        error_m=np.concatenate([d.errors(d.of_residual) for d in drawn]),
        weight=np.concatenate([d.along for d in drawn]),
        fold=np.repeat(folds, [len(d.residual) for d in drawn]),
    )
    return sheets(rays, np.unique(folds))


def _delayed(drawn: Sequence[_Drawn], side: float, sheet: Sheet | None) -> _Late | None:
    """The region by these views, on the surfaces or on a plane; None without rays through it, and where its delay is less than `LEAST_M`."""
    points = np.concatenate([d.points if sheet is None else sheet.crossings(d.origin, d.points) for d in drawn] or [np.zeros((0, 3))])
    seen = np.isfinite(points[:, 0])
    if not seen.any():
        return None
    grid = _grid(points[seen], side, sheet)
    numbers, which = np.unique(np.ravel_multi_index(tuple(grid.corners(points[seen]).astype(np.int64).T), grid.shape), return_inverse=True)
    # Rays that do not cross the plane are one cube more, which touches none and is never the region.
    corners = np.vstack([np.stack(np.unravel_index(numbers, grid.shape), axis=1), [[-9] * 3]])
    around, cube = touching(corners), np.full(len(points), len(numbers))
    cube[seen] = which
    of_view = np.split(cube, np.cumsum([len(d.residual) for d in drawn])[:-1])
    along = np.concatenate([d.along for d in drawn])
    weight = np.maximum(_sums(along, cube, len(corners)), np.finfo(float).tiny)
    inside, late = np.zeros(len(corners), bool), _Posed([d.errors(d.of_residual) for d in drawn], 0.0, 0.0)
    for _ in range(ROUNDS):
        inside = at_higher_level(_sums(along * np.concatenate(late.errors), cube, len(corners)), weight, around)
        inside[-1] = False
        late = _posed(drawn, [inside[c] for c in of_view])
    return None if late.delay_m < LEAST_M else _Late(replace(grid, inside=numbers[inside[:-1]]), late.explained)


def _grid(points: Float, side: float, sheet: Sheet | None) -> Cells:
    """Cubes over all points (n, 3); none of them inside."""
    at = np.floor(points / side)
    low = at.min(axis=0)
    x, y, z = (int(n) for n in at.max(axis=0) - low + 1)
    return Cells(side, low, (x, y, z), np.zeros(0, np.int64), sheet)


def _sums(values: Float, cube: Ints, cubes: int) -> Float:
    """(cubes,) sums of values (n,) by cube (n,)."""
    return np.asarray(np.bincount(cube, values, cubes), float)


def _posed(drawn: Sequence[_Drawn], inside: Sequence[Mask]) -> _Posed:
    """Poses by view and the delay of the rays `inside` (n,) over all, fitted together."""
    of_column, information, right = [], 0.0, 0.0
    for d, within in zip(drawn, inside, strict=True):
        column = within * d.per_metre
        shared = d.weighted.T @ column
        of_column.append(d.cov @ shared)
        information += float(d.weight @ column**2 / SHARED - shared @ of_column[-1])
        right += float(d.weight @ (column * d.residual) / SHARED - shared @ d.of_residual)
    delay_m = right / information if information > 0 else 0.0
    errors = [d.errors(d.of_residual - c * delay_m) for d, c in zip(drawn, of_column, strict=True)]
    return _Posed(errors, delay_m, delay_m * right)
