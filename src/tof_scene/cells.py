# SPDX-License-Identifier: Apache-2.0
"""Pixels as patches of the plane z = 1, and an undistorted raster over that plane, on which triangles can be drawn for any lens."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from tof_core.arrays import Float, Mask
    from tof_core.camera import Camera

EDGE = 1e-6
"""Share of a cell by which pixels are shrunk, so that without distortion each lies in one cell."""


@dataclass(frozen=True, slots=True, eq=False)
class Cells:
    """A raster over z = 1; without distortion, one cell per pixel.

    raster (4,) is x0, y0 (its lower corner), cells per unit of x and of y; shape (rows, columns);
    span (H*W, 4) int32 first and last column, first and last row of each pixel (empty where the lens has no ray);
    pixel (rows, columns) int32 the pixel at each cell, -1 for none;
    rays (H*W, 3) float64 through the centres; turn (H*W, 4) float64 is d(x, y)/du, d(x, y)/dv per pixel.
    """

    raster: Float
    shape: tuple[int, int]
    span: NDArray[np.int32]
    pixel: NDArray[np.int32]
    rays: Float
    turn: Float


@lru_cache(maxsize=8)
def cells_of(camera: Camera) -> Cells:
    """The raster of a camera."""
    rays = camera.rays().reshape(-1, 3)
    turn = _turn(camera)
    half = 0.5 * np.stack([np.abs(turn[:, 0]) + np.abs(turn[:, 2]), np.abs(turn[:, 1]) + np.abs(turn[:, 3])], 1)
    low, high = rays[:, :2] - half, rays[:, :2] + half
    corner = np.nanmin(low, axis=0)
    per_unit = np.array([camera.fx, camera.fy])
    columns, rows = (int(n) for n in np.maximum(np.rint((np.nanmax(high, axis=0) - corner) * per_unit), 1))
    seen: Mask = np.asarray(np.isfinite(low).all(axis=1))
    first = np.where(seen[:, None], np.floor((low - corner) * per_unit + EDGE), 0)
    last = np.where(seen[:, None], np.ceil((high - corner) * per_unit - EDGE) - 1, -1)
    limit = [columns - 1, rows - 1]
    first, last = np.clip(first, 0, limit).astype(np.int32), np.minimum(last, limit).astype(np.int32)
    span = np.ascontiguousarray(np.stack([first[:, 0], last[:, 0], first[:, 1], last[:, 1]], 1))
    pixel = np.full((rows, columns), -1, np.int32)
    for row, column in ((2, 0), (2, 1), (3, 0), (3, 1)):  # a pixel's corners, then its centre, which has priority
        pixel[span[seen, row], span[seen, column]] = np.flatnonzero(seen)
    middle = np.clip(np.floor((rays[seen, :2] - corner) * per_unit), 0, limit).astype(np.int32)
    pixel[middle[:, 1], middle[:, 0]] = np.flatnonzero(seen)
    return Cells(np.concatenate([corner, per_unit]), (rows, columns), span, pixel, np.ascontiguousarray(rays), turn)


def _turn(camera: Camera) -> Float:
    """(H*W, 4) derivatives of x and y per pixel along u, then along v."""
    if not camera.distorted:
        return np.tile([1 / camera.fx, 0.0, 0.0, 1 / camera.fy], (camera.height * camera.width, 1))
    v, u = np.mgrid[: camera.height, : camera.width]
    at = np.stack([u, v], -1).astype(float)
    right, down = np.array([0.5, 0]), np.array([0, 0.5])
    du = camera.rays_at(at + right) - camera.rays_at(at - right)
    dv = camera.rays_at(at + down) - camera.rays_at(at - down)
    return np.ascontiguousarray(np.concatenate([du[..., :2], dv[..., :2]], -1).reshape(-1, 4))
