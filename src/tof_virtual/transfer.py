# SPDX-License-Identifier: Apache-2.0
"""Compiled loops of indirect light: power from patches to points and to each other, and its interpolation on surfaces."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numba import njit

from tof_virtual.bvh import shadow

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from tof_core.arrays import Float

NEAR, CUT = 8.0, 5
"""Patches whose area is more than an eighth of their squared distance are divided into 5 x 5."""


@njit(cache=True, error_model="numpy")
def irradiance_of_patches(
    boxes: Float,
    links: NDArray[np.int32],
    tri: Float,
    points: Float,
    normals: Float,
    distance: Float,
    sources: Float,
    facing: Float,
    area: Float,
    power: NDArray[np.complex128],
    wavenumber: float,
) -> NDArray[np.complex128]:
    """Irradiance of points by patches, with the phase of the points' direct path subtracted."""
    out = np.zeros(points.shape[0], np.complex128)
    stack = np.empty(96, np.int32)
    hint = np.int64(-1)
    for p in range(points.shape[0]):
        px, py, pz = points[p, 0], points[p, 1], points[p, 2]
        nx, ny, nz = normals[p, 0], normals[p, 1], normals[p, 2]
        total = 0j
        for s in range(sources.shape[0]):
            dx, dy, dz = sources[s, 0] - px, sources[s, 1] - py, sources[s, 2] - pz
            here = nx * dx + ny * dy + nz * dz
            there = -(facing[s, 0] * dx + facing[s, 1] * dy + facing[s, 2] * dz)
            d2 = dx * dx + dy * dy + dz * dz
            near = d2 < NEAR * area[s]
            if not near and (here <= 1e-9 or there <= 1e-9 or here * there < 1e-7 * np.pi * d2 * d2):
                continue
            z = (
                near_patch(points[p], normals[p], sources[s], facing[s], area[s], wavenumber)
                if near
                else far_patch(here, there, d2, area[s], wavenumber)
            )
            if z == 0:
                continue
            found = shadow(boxes, links, tri, stack, hint, px + 1e-6 * nx, py + 1e-6 * ny, pz + 1e-6 * nz, dx, dy, dz)
            if found >= 0:
                hint = found
                continue
            total += power[s] * z
        # (emitter, patch, point, camera) halved, less the direct way; the emitter's share is in the power
        turn = -0.5 * wavenumber * distance[p]
        out[p] = total * complex(np.cos(turn), np.sin(turn))
    return out


@njit(cache=True, inline="always", error_model="numpy")
def far_patch(here: float, there: float, d2: float, area: float, wavenumber: float) -> complex:
    """Irradiance per power over a distance, with half its phase; a patch is a disc that fills at most half of the hemisphere."""
    turn = 0.5 * wavenumber * np.sqrt(d2)
    return here * there / (d2 * (np.pi * d2 + area)) * complex(np.cos(turn), np.sin(turn))


@njit(cache=True, error_model="numpy")
def near_patch(point: Float, normal: Float, source: Float, facing: Float, area: float, wavenumber: float) -> complex:
    """The same for a patch that is large for its distance: divided into squares on its tangent plane."""
    i = int(np.argmin(np.abs(facing)))
    x = np.zeros(3)
    x[i] = 1.0
    x -= facing[i] * facing
    x /= np.sqrt(x[0] ** 2 + x[1] ** 2 + x[2] ** 2)
    y = np.array([facing[1] * x[2] - facing[2] * x[1], facing[2] * x[0] - facing[0] * x[2], facing[0] * x[1] - facing[1] * x[0]])
    side, total, facing_us = np.sqrt(area) / CUT, 0j, 0
    for j in range(CUT):
        for k in range(CUT):
            d = source + (j - 0.5 * (CUT - 1)) * side * x + (k - 0.5 * (CUT - 1)) * side * y - point
            here = normal[0] * d[0] + normal[1] * d[1] + normal[2] * d[2]
            there = -(facing[0] * d[0] + facing[1] * d[1] + facing[2] * d[2])
            d2 = d[0] ** 2 + d[1] ** 2 + d[2] ** 2
            if here > 0 and there > 0 and d2 > 1e-12:
                total += far_patch(here, there, d2, area / CUT**2, wavenumber)
                facing_us += 1
    # squares behind the point's plane lie beyond a corner, while the cone ended on this side of it
    return total / max(facing_us, 1)


@njit(cache=True, error_model="numpy")
def transfer(
    boxes: Float,
    links: NDArray[np.int32],
    tri: Float,
    points: Float,
    normals: Float,
    area: Float,
    wavenumber: float,
) -> NDArray[np.complex128]:
    """(n, n): irradiance of patch i per power of patch j, with half the phase of the way between."""
    n = points.shape[0]
    out = np.zeros((n, n), np.complex128)
    stack = np.empty(96, np.int32)
    hint = np.int64(-1)
    for i in range(n):
        for j in range(i):
            d = points[j] - points[i]
            here = normals[i, 0] * d[0] + normals[i, 1] * d[1] + normals[i, 2] * d[2]
            there = -(normals[j, 0] * d[0] + normals[j, 1] * d[1] + normals[j, 2] * d[2])
            d2 = d[0] ** 2 + d[1] ** 2 + d[2] ** 2
            if here <= 1e-9 or there <= 1e-9:
                continue
            found = shadow(boxes, links, tri, stack, hint, points[i, 0], points[i, 1], points[i, 2], d[0], d[1], d[2])
            if found >= 0:
                hint = found
                continue
            turn = 0.5 * wavenumber * np.sqrt(d2)
            z = here * there / d2 * complex(np.cos(turn), np.sin(turn))
            out[i, j] = z / (np.pi * d2 + area[j])
            out[j, i] = z / (np.pi * d2 + area[i])
    return out


@njit(cache=True)
def interpolate(
    out: NDArray[np.complex128],
    gathered: NDArray[np.complex128],
    points: Float,
    normals: Float,
    face: NDArray[np.int32],
    rows: NDArray[np.int64],
    columns: NDArray[np.int64],
    width: int,
) -> NDArray[np.bool_]:
    """Bilinear on the raster between coarse points of the same smooth surface; returns the pixels that have none."""
    left = np.zeros(face.size, np.bool_)
    stride = rows[1]
    for v in range(face.size // width):
        a = min(v // stride, rows.size - 2)
        fv = (v - rows[a]) / (rows[a + 1] - rows[a])
        for u in range(width):
            p = v * width + u
            if face[p] < 0:
                continue
            b = min(u // stride, columns.size - 2)
            fu = (u - columns[b]) / (columns[b + 1] - columns[b])
            total, value = 0.0, 0j
            for k in range(4):
                i, j = a + k // 2, b + k % 2
                q = rows[i] * width + columns[j]
                if face[q] < 0:
                    continue
                alike = normals[p, 0] * normals[q, 0] + normals[p, 1] * normals[q, 1] + normals[p, 2] * normals[q, 2]
                off = 0.0
                for c in range(3):
                    off += normals[p, c] * (points[q, c] - points[p, c])
                if alike < 0.9 or abs(off) > 0.01:
                    continue
                w = (fv if k // 2 else 1 - fv) * (fu if k % 2 else 1 - fu) + 1e-6
                total += w
                value += w * gathered[i * columns.size + j]
            if total > 1e-3:
                out[p] = value / total
            else:
                left[p] = True
    return left
