# SPDX-License-Identifier: Apache-2.0
"""Nearest neighbours of lone points: a search outwards over the tiles of the raster, which skips those whose bounds are further away."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numba import njit

if TYPE_CHECKING:
    from tof_core.arrays import Image, Ints

NOWHERE = 1e6
"""Coordinate in metres of a pixel without depth: never among the nearest."""
TILE = 8
FAR = 64
"""Radius in pixels at which the search ends once it has k neighbours: a point whose neighbours lie beyond is an outlier anyway."""


@njit(cache=True, fastmath=True)
def reach2(x: np.float32, y: np.float32, z: np.float32, pitch: float, radius: int) -> np.float32:
    """Squared distance below which no point outside the window of this radius can be."""
    off = np.float32((radius + 1) * pitch)
    ray = np.sqrt(x * x + y * y + z * z) / z
    reach: np.float32 = z * off / (ray + off)
    return reach * reach


@njit(cache=True)
def boxes(cloud: Image, pad: int) -> Image:
    """Bounds (rows, columns, 6) of the points of each tile; an empty tile's are far away."""
    height, width = cloud.shape[1] - 2 * pad, cloud.shape[2] - 2 * pad
    bounds = np.empty(((height + TILE - 1) // TILE, (width + TILE - 1) // TILE, 6), np.float32)
    bounds[..., :3], bounds[..., 3:] = NOWHERE, -NOWHERE
    for v in range(height):
        for u in range(width):
            if cloud[2, v + pad, u + pad] < NOWHERE:
                r, c = v // TILE, u // TILE
                for i in range(3):
                    value = cloud[i, v + pad, u + pad]
                    bounds[r, c, i] = min(bounds[r, c, i], value)
                    bounds[r, c, i + 3] = max(bounds[r, c, i + 3], value)
    return bounds


@njit(cache=True, fastmath=True, error_model="numpy")
def outwards(cloud: Image, bounds: Image, pitch: float, k: int, pad: int, pixels: Ints, rest: Ints, out: Image) -> None:
    """Search ring after ring of tiles for those of the pixels (flat indices) named by `rest`."""
    width = cloud.shape[2] - 2 * pad
    rows, columns = bounds.shape[:2]
    least, d2 = np.empty(k, np.float32), np.empty(TILE * TILE, np.float32)
    for i in rest:
        v, u = pixels[i] // width, pixels[i] % width
        x, y, z = cloud[0, v + pad, u + pad], cloud[1, v + pad, u + pad], cloud[2, v + pad, u + pad]
        least[:] = NOWHERE
        for ring in range(max(rows, columns)):
            inside = reach2(x, y, z, pitch, max((ring - 1) * TILE, 0)) if ring else np.float32(0.0)
            if least[k - 1] <= inside or (ring > FAR // TILE and least[k - 1] < NOWHERE):
                break
            for row in range(max(0, v // TILE - ring), min(rows, v // TILE + ring + 1)):
                whole = abs(row - v // TILE) == ring
                for column in range(u // TILE - ring, u // TILE + ring + 1, 1 if whole or ring == 0 else 2 * ring):
                    if 0 <= column < columns and _box_distance2(bounds, row, column, x, y, z) < least[k - 1]:
                        _merge(cloud, row * TILE + pad, column * TILE + pad, x, y, z, d2, least)
        total = np.float32(0.0)
        for j in range(k):
            total += np.sqrt(least[j])
        out[i] = total / k


@njit(cache=True, fastmath=True)
def _box_distance2(bounds: Image, r: int, c: int, x: np.float32, y: np.float32, z: np.float32) -> np.float32:
    dx = max(bounds[r, c, 0] - x, x - bounds[r, c, 3], np.float32(0.0))
    dy = max(bounds[r, c, 1] - y, y - bounds[r, c, 4], np.float32(0.0))
    dz = max(bounds[r, c, 2] - z, z - bounds[r, c, 5], np.float32(0.0))
    distance2: np.float32 = dx * dx + dy * dy + dz * dz
    return distance2


@njit(cache=True, fastmath=True)
def _merge(cloud: Image, row: int, column: int, x: np.float32, y: np.float32, z: np.float32, d2: Image, least: Image) -> None:
    """Merge a tile's points into the sorted least squared distances; what lies beyond the raster is nowhere."""
    last = least.size - 1
    for v in range(TILE):
        for u in range(TILE):
            dx, dy, dz = cloud[0, row + v, column + u] - x, cloud[1, row + v, column + u] - y, cloud[2, row + v, column + u] - z
            d2[v * TILE + u] = dx * dx + dy * dy + dz * dz
    for value in d2:
        if value < least[last]:
            j = last
            while j > 0 and least[j - 1] > value:
                least[j] = least[j - 1]
                j -= 1
            least[j] = value
