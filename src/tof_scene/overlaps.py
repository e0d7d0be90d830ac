# SPDX-License-Identifier: Apache-2.0
"""Which triangles touch which of the pixels looked at closely: drawn once over the raster, hidden ones included."""

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
    """Triangles over each pixel of `pixels` (k,): start (k + 1,) into face ids (c,), and rows (m, 3, 3).

    `points` (n, 3) are in the camera frame. For a direction d, `rows[f] @ d` are the barycentric coordinates divided by z where
    the ray along d = (x, y, 1) meets face f's plane: all positive inside, their sum 1/z (Olano and Greer, Triangle scan
    conversion using 2D homogeneous coordinates, 1997). Vertices behind the camera need no clipping so. Rows are filled for
    the faces listed.
    """
    first, entries = _per_cell(cells.span[pixels], *cells.shape)
    rows = np.empty((len(faces), 3, 3))
    spread = np.abs(cells.turn[pixels]) / 2
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
    """Write each (face, pixel) that may overlap; returns how many there are, which may be more than there is room for."""
    count, width = 0, shape[1]
    for f in range(len(faces)):
        c0, c1, r0, r1 = _box(points[faces[f, 0]], points[faces[f, 1]], points[faces[f, 2]], raster, shape)
        ready = False
        for r in range(r0, r1 + 1):
            for at in range(first[r * width + c0], first[r * width + c1 + 1]):
                if not ready:
                    _barycentric(points[faces[f, 0]], points[faces[f, 1]], points[faces[f, 2]], rows[f])
                    ready = True
                k = entries[at]
                if _may_overlap(rows[f], rays[k], spread[k]):
                    if count < len(face):
                        face[count], entry[count] = f, k
                    count += 1
    return count


@njit(cache=True, nogil=True)
def _box(a: Float, b: Float, c: Float, raster: Float, shape: tuple[int, int]) -> tuple[int, int, int, int]:
    """Columns and rows that a triangle's front part spans; none when it is wholly behind or beside."""
    u0 = v0 = np.inf
    u1 = v1 = -np.inf
    for p, q in ((a, b), (b, c), (c, a)):
        if p[2] >= NEAR_M:
            x, y, z = p[0], p[1], p[2]
            u, v = (x / z - raster[0]) * raster[2], (y / z - raster[1]) * raster[3]
            u0, u1, v0, v1 = min(u0, u), max(u1, u), min(v0, v), max(v1, v)
        if (p[2] >= NEAR_M) != (q[2] >= NEAR_M):
            s = (NEAR_M - p[2]) / (q[2] - p[2])
            u, v = (p[0] + s * (q[0] - p[0])) / NEAR_M, (p[1] + s * (q[1] - p[1])) / NEAR_M
            u, v = (u - raster[0]) * raster[2], (v - raster[1]) * raster[3]
            u0, u1, v0, v1 = min(u0, u), max(u1, u), min(v0, v), max(v1, v)
    if not (u1 >= 0 and v1 >= 0 and u0 <= shape[1] and v0 <= shape[0]):
        return 0, -1, 0, -1
    return int(max(u0, 0.0)), int(min(u1, shape[1] - 1.0)), int(max(v0, 0.0)), int(min(v1, shape[0] - 1.0))


@njit(cache=True, nogil=True)
def _barycentric(a: Float, b: Float, c: Float, out: Float) -> None:
    """Inverse of the matrix with columns a, b, c; zeros where the camera lies in the triangle's plane."""
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        out[0, i] = b[j] * c[k] - b[k] * c[j]
        out[1, i] = c[j] * a[k] - c[k] * a[j]
        out[2, i] = a[j] * b[k] - a[k] * b[j]
    volume = a[0] * out[0, 0] + a[1] * out[0, 1] + a[2] * out[0, 2]
    scale = 1.0 / volume if abs(volume) > 1e-30 else 0.0
    out *= scale


@njit(cache=True, nogil=True, inline="always")
def _may_overlap(rows: Float, ray: Float, spread: Float) -> bool:
    """False when the pixel lies wholly beyond one side, or behind."""
    total = reach = 0.0
    for i in range(3):
        middle = rows[i, 0] * ray[0] + rows[i, 1] * ray[1] + rows[i, 2]
        extent = abs(rows[i, 0]) * (spread[0] + spread[2]) + abs(rows[i, 1]) * (spread[1] + spread[3])
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
