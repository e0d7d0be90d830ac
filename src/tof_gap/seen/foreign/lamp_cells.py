# SPDX-License-Identifier: Apache-2.0
"""Means of a view's errors over squares of pixels, in which another camera's fringes show, beside what else makes waves."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING

import numpy as np

from tof_core.stats import beside, blocks, hats
from tof_gap.seen.foreign.lamp_light import RIDGE, STRONGEST

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Float, Mask
    from tof_gap.limits.foreign import ForeignLampLimits
    from tof_gap.seen.evidence.view import ViewEvidence

STEEPEST = 0.1
"""Least cosine of incidence used: grazing surfaces would outweigh all others."""
COMMON_STEP_M = 0.15
"""Spacing along range of the knots of the error that all views share: an eighth of a wave of 120 MHz."""


@dataclass(frozen=True, slots=True, eq=False)
class Cells:
    """Means over squares of pixels of a view.

    points, normals (n, 3) in the cell; part (n,): index of the part that most pixels see; range_m, cosine, amplitude (n,); opposite_m,
    opposite_amplitude (n,): range and amplitude opposite the middle of the image, the cell's own range and no light where nothing is seen
    there; across (n, 2): place in the image, -0.5 to 0.5 along rows and columns; sigma (n,): standard deviation of the mean error along the ray, metres;
    smooth (n, k): orthonormal fields, divided by sigma, that errors of pose and lens make; error (n,): divided by sigma, without these
    fields; T (4, 4): the camera's pose.
    """

    points: Float
    normals: Float
    part: Float
    range_m: Float
    cosine: Float
    amplitude: Float
    opposite_m: Float
    opposite_amplitude: Float
    across: Float
    sigma: Float
    smooth: Float
    error: Float
    T: Float

    def in_cell(self, places: Float, *, on_hand: bool) -> Float:
        """Places (..., 3), in this camera's frame if `on_hand`, in the cell."""
        return np.asarray(places @ self.T[:3, :3].T + self.T[:3, 3]) if on_hand else places


def chi2_of(cells: Sequence[Cells | None]) -> float:
    """Chi-square of the errors of all cells."""
    return sum(float(c.error @ c.error) for c in cells if c is not None)


def cells_of(view: ViewEvidence, limits: ForeignLampLimits) -> Cells | None:
    """The means of a view; None where too few pixels are seen."""
    seen, T = view.smooth, view.rendering.T_cell_camera
    h, w = view.residual.shape
    groups = blocks(seen, max(1, h // limits.rows))
    if len(groups.count) < limits.cells:
        return None
    row, column = np.nonzero(seen)
    point = np.stack([groups.mean(x) for x in view.frame.points[seen].T], axis=1) @ T[:3, :3].T + T[:3, 3]
    normal = np.stack([groups.mean(x) for x in np.nan_to_num(view.rendering.normal[seen]).T], axis=1) @ T[:3, :3].T
    far, light = (np.where(np.isfinite(a), a, 0.0)[::-1, ::-1] for a in (view.frame.radial, view.frame.amplitude))
    light = np.where(far > 0, light, 0.0)
    range_m, cosine, amplitude, opposite_m, opposite_amplitude, along, white, y, x = (
        groups.mean(q)
        for q in (
            view.frame.radial[seen],
            np.cos(view.rendering.incidence[seen]),
            view.frame.amplitude[seen],
            np.where(light > 0, far, view.frame.radial)[seen],
            light[seen],
            (view.residual * view.frame.length)[seen],
            ((view.mean_sigma * view.frame.length)[seen]) ** 2,
            row / h - 0.5,
            column / w - 0.5,
        )
    )
    sigma = np.hypot(np.sqrt(white / groups.count), limits.rough_mm * 1e-3)
    of_lens = np.stack([np.ones_like(x), x, y, range_m / range_m.mean() - 1, x * y, x * x, y * y], axis=1) / sigma[:, None]
    smooth, _ = np.linalg.qr(of_lens)
    error = beside(smooth, along / sigma)
    facing = np.maximum(cosine, STEEPEST)
    of = view.rendering.part[seen]
    names = np.unique(of)
    part = names[np.argmax([groups.mean((of == name).astype(float)) for name in names], axis=0)]
    here = point, normal, part, range_m, facing, amplitude, opposite_m, opposite_amplitude, np.stack([x, y], axis=1)
    return Cells(*(np.ascontiguousarray(a, np.float64) for a in (*here, sigma, smooth, error, T)))


def beside_pose(c: Cells) -> Cells:
    """The cells less the error that a small motion of the camera makes, in first order.

    A pose that is solved beside an error of the camera follows it, in each view in its own way.
    """
    way = c.points - c.T[:3, 3]
    along = np.einsum("ni,ni->n", c.normals, way) / np.linalg.norm(way, axis=1)
    slope = c.normals / np.copysign(np.maximum(np.abs(along), STEEPEST), along)[:, None]
    smooth, _ = np.linalg.qr(np.concatenate([c.smooth, np.concatenate([slope, np.cross(way, slope)], axis=1) / c.sigma[:, None]], axis=1))
    return replace(c, smooth=smooth, error=beside(smooth, c.error))


def beside_common(cells: Sequence[Cells | None]) -> list[Cells | None]:
    """The cells less errors of pose, and less the error that all views share.

    An error of the camera itself, such as light that its own glass reflects, is the same in every view, even if its fringes look like
    those of a lamp: functions of range, of range times r^2 / cos(i), and of range over amplitude. Light within the camera acts on dark
    surfaces most, another lamp's light on surfaces of any albedo alike. Its strength may change linearly over the image. Light that the
    lens reflects twice comes from the surface opposite the middle of the image: functions of how much farther that surface is, times the
    ratio of amplitudes.
    """
    there = [beside_pose(c) for c in cells if c is not None]
    if not there:
        return list(cells)
    knots, of_ghost = _knots([c.range_m for c in there]), _knots([c.opposite_m - c.range_m for c in there])
    usual = float(np.median(np.concatenate([c.amplitude for c in there])))

    def columns(c: Cells) -> Float:
        of_range = hats(c.range_m, knots)
        bright = np.maximum(c.amplitude, usual / STRONGEST)
        within, ghost = usual / bright, np.minimum(c.opposite_amplitude / bright, STRONGEST)
        weak = c.range_m**2 / c.cosine, within, *(within * place for place in c.across.T)
        of_lens = hats(c.opposite_m - c.range_m, of_ghost) * ghost[:, None]
        B = np.concatenate([of_range, *(of_range * w[:, None] for w in weak), of_lens], axis=1) / c.sigma[:, None]
        return beside(c.smooth, B)

    all_columns = [columns(c) for c in there]
    normal, right = sum(B.T @ B for B in all_columns), sum(B.T @ c.error for B, c in zip(all_columns, there, strict=True))
    common = np.linalg.solve(ridged(np.asarray(normal)), right)
    less = iter([replace(c, error=c.error - B @ common) for B, c in zip(all_columns, there, strict=True)])
    return [None if c is None else next(less) for c in cells]


def _knots(values: Sequence[Float]) -> Float:
    """Knots `COMMON_STEP_M` apart over values (n,) of all views."""
    low, high = (f([f(v) for v in values]) for f in (min, max))
    return np.linspace(low, high, max(2, round((high - low) / COMMON_STEP_M) + 1))


def beside_loudest_part(cells: Sequence[Cells | None]) -> list[Cells | None]:
    """The cells that are not on the part with most chi-square; all where no view shows enough of other parts.

    Waves on one part may be its shape. A lamp's light falls on others as well.
    """
    there = [c for c in cells if c is not None]
    part, error = (np.concatenate([getattr(c, name) for c in there]) for name in ("part", "error"))
    loudest = int(np.argmax(np.bincount(part.astype(np.int64), error**2)))
    others = [None if c is None else _only(c, c.part != loudest) for c in cells]
    return others if any(c is not None for c in others) else list(cells)


def _only(c: Cells, kept: Mask) -> Cells | None:
    """Some cells of a view; None where they are no more than its smooth fields."""
    if kept.sum() <= c.smooth.shape[1]:
        return None
    smooth, _ = np.linalg.qr(c.smooth[kept])
    of_cell = {f.name: np.ascontiguousarray(getattr(c, f.name)[kept]) for f in fields(c) if f.name not in ("smooth", "error", "T")}
    return Cells(**of_cell, smooth=np.ascontiguousarray(smooth), error=beside(smooth, c.error[kept]), T=c.T)


def ridged(normal: Float) -> Float:
    """Normal equations (k, k) with a ridge."""
    return np.asarray(normal + (RIDGE * np.trace(normal) / len(normal) + 1e-12) * np.eye(len(normal)))
