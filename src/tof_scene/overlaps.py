# SPDX-License-Identifier: Apache-2.0
"""The triangles, hidden ones included, that touch each finely sampled pixel."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numba import njit

from tof_scene.seams import NEAR_M

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from tof_core.arrays import Float
    from tof_scene.cells import Cells

    Int32 = NDArray[np.int32]


def overlaps(points: Float, faces: Int32, cells: Cells, pixels: NDArray[np.int64]) -> tuple[Int32, Int32, Float]:
    """Triangles that may touch each pixel of `pixels` (k,): start (k + 1,) into face ids (c,), and rows (m, 3, 3).

    `points` (n, 3) are in the camera frame. For a direction d, `rows[f] @ d` are the barycentric coordinates divided by z where
    the ray along d = (x, y, 1) meets face f's plane: all positive inside, their sum 1/z (Olano and Greer, Triangle scan
    conversion using 2D homogeneous coordinates, 1997). Vertices behind the camera therefore need no clipping. Rows are filled for
    the faces listed.
    """
    first, entries = _per_cell(cells.span[pixels], *cells.shape)
    rows = np.empty((len(faces), 3, 3))
    spread = (np.abs(cells.turn[pixels, :2]) + np.abs(cells.turn[pixels, 2:])) / 2
    room = 64 * len(pixels) + 4096
    while True:
        face, entry = np.empty(room, np.int32), np.empty(room, np.int32)
        count = _draw(points, faces, cells.raster, cells.shape, first, entries, cells.rays[pixels], spread, rows, face, entry)
        if count <= room:
            return *_sorted(face[:count], entry[:count], len(pixels)), rows
        room = count


@njit(cache=True, nogil=True)
def _per_cell(span: Int32, height: int, width: int) -> tuple[Int32, Int32]:
    """Pixels of each cell: start (cells + 1,) into their list."""
    start = np.zeros(height * width + 1, np.int32)
    for c0, c1, r0, r1 in span:
        for r in range(r0, r1 + 1):
            for c in range(c0, c1 + 1):
                start[r * width + c + 1] += 1
    start = np.cumsum(start).astype(np.int32)
    at, entries = start.copy(), np.empty(start[-1], np.int32)
    for k in range(len(span)):
        for r in range(span[k, 2], span[k, 3] + 1):
            for c in range(span[k, 0], span[k, 1] + 1):
                entries[at[r * width + c]] = k
                at[r * width + c] += 1
    return start, entries


@njit(cache=True, nogil=True)
def _draw(
    points: Float, faces: Int32, raster: Float, shape: tuple[int, int], first: Int32, entries: Int32, rays: Float, spread: Float,
    rows: Float, face: Int32, entry: Int32,
) -> int:  # fmt: skip
    """Write each pair (face, pixel) that may overlap; returns the number of pairs, which may exceed the size of the arrays.

    A pixel of a distorted lens lies in up to four cells; each face tests it once.
    """
    count, width = 0, shape[1]
    asked_by = np.full(len(rays), -1, np.int32)
    for f in range(len(faces)):
        c0, c1, r0, r1 = _box(points, faces, f, raster, shape)
        ready = False
        for r in range(r0, r1 + 1):
            for at in range(first[r * width + c0], first[r * width + c1 + 1]):
                if not ready:
                    _barycentric(points, faces, f, rows)
                    ready = True
                k = entries[at]
                if asked_by[k] == f:
                    continue
                asked_by[k] = f
                if _may_overlap(rows, f, rays, spread, k):
                    if count < len(face):
                        face[count], entry[count] = f, k
                    count += 1
    return count


@njit(cache=True, nogil=True)
def _box(points: Float, faces: Int32, f: int, raster: Float, shape: tuple[int, int]) -> tuple[int, int, int, int]:
    """Columns and rows spanned by the part of a triangle in front of the camera; none if that is outside the image."""
    u0 = v0 = np.inf
    u1 = v1 = -np.inf
    for i in range(3):
        p, q = faces[f, i], faces[f, (i + 1) % 3]
        z, z_next = points[p, 2], points[q, 2]
        if z >= NEAR_M:
            u, v = (points[p, 0] / z - raster[0]) * raster[2], (points[p, 1] / z - raster[1]) * raster[3]
            u0, u1, v0, v1 = min(u0, u), max(u1, u), min(v0, v), max(v1, v)
        if (z >= NEAR_M) != (z_next >= NEAR_M):
            s = (NEAR_M - z) / (z_next - z)
            x, y = points[p, 0] + s * (points[q, 0] - points[p, 0]), points[p, 1] + s * (points[q, 1] - points[p, 1])
            u, v = (x / NEAR_M - raster[0]) * raster[2], (y / NEAR_M - raster[1]) * raster[3]
            u0, u1, v0, v1 = min(u0, u), max(u1, u), min(v0, v), max(v1, v)
    if not (u1 >= 0 and v1 >= 0 and u0 <= shape[1] and v0 <= shape[0]):
        return 0, -1, 0, -1
    return int(max(u0, 0.0)), int(min(u1, shape[1] - 1.0)), int(max(v0, 0.0)), int(min(v1, shape[0] - 1.0))


@njit(cache=True, nogil=True)
def _barycentric(points: Float, faces: Int32, f: int, rows: Float) -> None:
    """Inverse of the matrix whose columns are the corners; zeros where the camera lies in the triangle's plane."""
    a, b, c = faces[f]
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        rows[f, 0, i] = points[b, j] * points[c, k] - points[b, k] * points[c, j]
        rows[f, 1, i] = points[c, j] * points[a, k] - points[c, k] * points[a, j]
        rows[f, 2, i] = points[a, j] * points[b, k] - points[a, k] * points[b, j]
    volume = points[a, 0] * rows[f, 0, 0] + points[a, 1] * rows[f, 0, 1] + points[a, 2] * rows[f, 0, 2]
    scale = 1.0 / volume if abs(volume) > 1e-30 else 0.0
    for i in range(3):
        for j in range(3):
            rows[f, i, j] *= scale


@njit(cache=True, nogil=True, inline="always")
def _may_overlap(rows: Float, f: int, rays: Float, spread: Float, k: int) -> bool:
    """False if the pixel is entirely beyond one side of the triangle, or the triangle is behind the camera."""
    total = reach = 0.0
    for i in range(3):
        middle = rows[f, i, 0] * rays[k, 0] + rows[f, i, 1] * rays[k, 1] + rows[f, i, 2]
        extent = abs(rows[f, i, 0]) * spread[k, 0] + abs(rows[f, i, 1]) * spread[k, 1]
        if middle + extent < 0.0:
            return False
        total += middle
        reach += extent
    return total + reach > 0.0


@njit(cache=True, nogil=True)
def _sorted(face: Int32, entry: Int32, n: int) -> tuple[Int32, Int32]:
    """The same pairs grouped by pixel: start (n + 1,) and faces."""
    start = np.zeros(n + 1, np.int32)
    for k in entry:
        start[k + 1] += 1
    start = np.cumsum(start).astype(np.int32)
    at, out = start.copy(), np.empty(len(face), np.int32)
    for i in range(len(face)):
        out[at[entry[i]]] = face[i]
        at[entry[i]] += 1
    return start, out
