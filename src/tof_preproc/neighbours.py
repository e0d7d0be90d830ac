# SPDX-License-Identifier: Apache-2.0
"""Mean distance of each point to its nearest neighbours, searched in the raster instead of a tree.

A pixel r columns or rows away lies on a ray at least r pixels away, so its point is at least about z r pitch away,
whatever its depth. Once the k-th distance found is below that, no pixel further out can be nearer: the result is as
exact as that of a k-d tree. One window is enough for nearly all pixels, 64 of a row at a time. The others search
outwards, tile by tile, and skip the tiles whose bounds are further away.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numba import njit

if TYPE_CHECKING:
    from tof_core.arrays import Float, Image, Ints
    from tof_core.camera import Camera

NOWHERE = 1e6
"""Coordinate in metres of a pixel without depth: never among the nearest."""
LANES = 64
"""Pixels of a row that are worked on together."""
WINDOW = 1.75
"""Radius of the first window, in radii of a disc that holds k pixels."""
STEPS = 6
"""Secant steps to the k-th distance."""
TILE = 8
FAR = 64
"""Radius in pixels at which the search ends once it has k neighbours: a point whose neighbours lie beyond is an outlier anyway."""


def mean_distance(depth: Image, camera: Camera, k: int) -> Image:
    """Mean distance (H, W) in metres to the k nearest points, the point itself (at 0) among them, as Open3D counts.

    NaN where there is no depth; fewer than k points in all: the mean over those there are.
    """
    radius = max(2, int(np.ceil(WINDOW * np.sqrt(k / np.pi))))
    rays = camera.rays()
    pad = radius + LANES
    cloud = np.full((3, depth.shape[0] + 2 * radius, depth.shape[1] + 2 * pad), np.float32(NOWHERE))
    points = _fill(cloud, depth, rays, radius, pad)
    out = np.full(depth.shape, np.float32(np.nan))
    if points > 0:
        pitch, k = _pitch(camera), min(k, points)
        rest = _inside(cloud, pitch, k, radius, pad, out)
        _outwards(cloud, pitch, k, radius, pad, rest, out)
    return out


@lru_cache(maxsize=16)
def _pitch(camera: Camera) -> float:
    """Least step between neighbouring rays at z = 1."""
    rays = camera.rays()
    steps = [np.abs(np.diff(rays[..., axis], axis=1 - axis)) for axis in (0, 1)]
    return float(min((np.nanmin(s) for s in steps if s.size), default=camera.pixel_angle))


@njit(cache=True)
def _fill(cloud: Image, depth: Image, rays: Float, radius: int, pad: int) -> int:
    """Points (3, H + 2 radius, W + 2 pad) of a depth image; how many there are."""
    points = 0
    for v in range(depth.shape[0]):
        for u in range(depth.shape[1]):
            z, x, y = depth[v, u], rays[v, u, 0], rays[v, u, 1]
            if np.isfinite(z) and np.isfinite(x) and np.isfinite(y):
                cloud[0, v + radius, u + pad] = x * z
                cloud[1, v + radius, u + pad] = y * z
                cloud[2, v + radius, u + pad] = z
                points += 1
    return points


@njit(cache=True, fastmath=True)
def _reach2(x: np.float32, y: np.float32, z: np.float32, pitch: float, radius: int) -> np.float32:
    """Squared distance below which no point outside the window of this radius can be."""
    off = np.float32((radius + 1) * pitch)
    ray = np.sqrt(x * x + y * y + z * z) / z
    reach: np.float32 = z * off / (ray + off)
    return reach * reach


@njit(cache=True, fastmath=True, error_model="numpy")
def _inside(cloud: Image, pitch: float, k: int, radius: int, pad: int, out: Image) -> Ints:
    """Fill `out` where the window holds the k nearest; return the other pixels (n, 2)."""
    height, width = out.shape
    d2 = np.empty(((2 * radius + 1) ** 2, LANES), np.float32)
    reach2, mean, lo, n_lo = (
        np.empty(LANES, np.float32),
        np.empty(LANES, np.float32),
        np.empty(LANES, np.float32),
        np.empty(LANES, np.float32),
    )
    n_hi, guess, n, total = (
        np.empty(LANES, np.float32),
        np.empty(LANES, np.float32),
        np.empty(LANES, np.float32),
        np.empty(LANES, np.float32),
    )
    rest = np.empty((height * width, 2), np.int32)
    waiting = 0
    for v in range(height):
        for start in range(0, width, LANES):
            at = start + pad
            x, y, z = cloud[0, v + radius, at : at + LANES], cloud[1, v + radius, at : at + LANES], cloud[2, v + radius, at : at + LANES]
            for c in range(LANES):
                reach2[c] = _reach2(x[c], y[c], z[c], pitch, radius)
            _window(cloud, v, at, radius, x, y, z, d2)
            _select(d2, k, reach2, mean, lo, n_lo, n_hi, guess, n, total)
            for c in range(min(LANES, width - start)):
                if z[c] < NOWHERE:
                    if mean[c] >= 0:
                        out[v, start + c] = mean[c]
                    else:
                        rest[waiting, 0], rest[waiting, 1] = v, start + c
                        waiting += 1
    return rest[:waiting]


@njit(cache=True, fastmath=True)
def _window(cloud: Image, v: int, at: int, radius: int, x: Image, y: Image, z: Image, d2: Image) -> None:
    """Squared distances (window, LANES) of LANES pixels of a row to all pixels of their windows."""
    o = 0
    for dv in range(2 * radius + 1):
        for du in range(at - radius, at + radius + 1):
            xs, ys, zs = cloud[0, v + dv, du : du + LANES], cloud[1, v + dv, du : du + LANES], cloud[2, v + dv, du : du + LANES]
            row = d2[o]
            for c in range(LANES):
                dx, dy, dz = xs[c] - x[c], ys[c] - y[c], zs[c] - z[c]
                row[c] = dx * dx + dy * dy + dz * dz
            o += 1


@njit(cache=True, fastmath=True)
def _select(d2: Image, k: int, hi: Image, mean: Image, lo: Image, n_lo: Image, n_hi: Image, at: Image, n: Image, total: Image) -> None:
    """`mean` root of the k least d2 of each lane, or -1 where fewer than k lie within `hi` or the k-th is not pinned down.

    The k-th least is bracketed by counting, all lanes at once. Points of a surface lie evenly over its area, so their
    number grows linearly with d2, and a secant finds the k-th in a few steps. The roots between the last brackets
    are counted by their mean. (Separate arrays, not rows of one: so the compiler sees that they do not overlap.)
    """
    lo[:], n_lo[:] = np.float32(0.0), np.float32(1.0)
    _count(d2, hi, n_hi)
    for _ in range(STEPS):
        _secant(lo, hi, n_lo, n_hi, at, np.float32(k))
        _count(d2, at, n)
        _bracket(lo, hi, n_lo, n_hi, at, n, np.float32(k))
    _sums(d2, lo, hi, n, total)
    for c in range(LANES):
        share = (k - n_lo[c]) / np.maximum(n_hi[c] - n_lo[c], np.float32(1.0))
        found = n_hi[c] >= k and (n_hi[c] - n_lo[c] <= np.float32(3.0) or hi[c] - lo[c] <= np.float32(0.1) * hi[c])
        mean[c] = (n[c] + share * total[c]) / k if found else np.float32(-1.0)


@njit(cache=True, fastmath=True)
def _secant(lo: Image, hi: Image, n_lo: Image, n_hi: Image, at: Image, k: float) -> None:
    for c in range(LANES):
        part = (k - np.float32(0.5) - n_lo[c]) / np.maximum(n_hi[c] - n_lo[c], np.float32(1.0))
        part = np.minimum(np.maximum(part, np.float32(0.05)), np.float32(0.95))
        at[c] = lo[c] + (hi[c] - lo[c]) * part


@njit(cache=True, fastmath=True)
def _bracket(lo: Image, hi: Image, n_lo: Image, n_hi: Image, at: Image, n: Image, k: float) -> None:
    for c in range(LANES):
        below = n[c] < k
        lo[c] = at[c] if below else lo[c]
        n_lo[c] = n[c] if below else n_lo[c]
        hi[c] = hi[c] if below else at[c]
        n_hi[c] = n_hi[c] if below else n[c]


@njit(cache=True, fastmath=True)
def _count(d2: Image, limit: Image, n: Image) -> None:
    n[:] = np.float32(0.0)
    for o in range(d2.shape[0]):
        row = d2[o]
        for c in range(LANES):
            n[c] += np.float32(1.0) if row[c] <= limit[c] else np.float32(0.0)


@njit(cache=True, fastmath=True)
def _sums(d2: Image, lo: Image, hi: Image, below: Image, between: Image) -> None:
    """Sums of roots up to lo, and from there up to hi."""
    below[:], between[:] = np.float32(0.0), np.float32(0.0)
    for o in range(d2.shape[0]):
        row = d2[o]
        for c in range(LANES):
            root = np.sqrt(row[c])
            below[c] += root if row[c] <= lo[c] else np.float32(0.0)
            between[c] += root if lo[c] < row[c] <= hi[c] else np.float32(0.0)


@njit(cache=True)
def _boxes(cloud: Image, radius: int, pad: int, height: int, width: int) -> Image:
    """Bounds (rows, columns, 6) of the points of each tile; an empty tile's are far away."""
    boxes = np.empty(((height + TILE - 1) // TILE, (width + TILE - 1) // TILE, 6), np.float32)
    boxes[..., :3], boxes[..., 3:] = NOWHERE, -NOWHERE
    for v in range(height):
        for u in range(width):
            if cloud[2, v + radius, u + pad] < NOWHERE:
                r, c = v // TILE, u // TILE
                for i in range(3):
                    value = cloud[i, v + radius, u + pad]
                    boxes[r, c, i] = min(boxes[r, c, i], value)
                    boxes[r, c, i + 3] = max(boxes[r, c, i + 3], value)
    return boxes


@njit(cache=True, fastmath=True, error_model="numpy")
def _outwards(cloud: Image, pitch: float, k: int, radius: int, pad: int, rest: Ints, out: Image) -> None:
    """Search ring after ring of tiles for the pixels (n, 2) whose neighbours are further off."""
    height, width = out.shape
    boxes = _boxes(cloud, radius, pad, height, width)
    rows, columns = boxes.shape[:2]
    least = np.empty(k, np.float32)
    for i in range(rest.shape[0]):
        v, u = rest[i]
        x, y, z = cloud[0, v + radius, u + pad], cloud[1, v + radius, u + pad], cloud[2, v + radius, u + pad]
        least[:] = NOWHERE
        for ring in range(max(rows, columns)):
            inside = _reach2(x, y, z, pitch, max((ring - 1) * TILE, 0)) if ring else np.float32(0.0)
            if least[k - 1] <= inside or (ring > FAR // TILE and least[k - 1] < NOWHERE):
                break
            for row in range(max(0, v // TILE - ring), min(rows, v // TILE + ring + 1)):
                whole = abs(row - v // TILE) == ring
                for column in range(u // TILE - ring, u // TILE + ring + 1, 1 if whole or ring == 0 else 2 * ring):
                    if 0 <= column < columns and _box_distance2(boxes, row, column, x, y, z) < least[k - 1]:
                        _merge(cloud, row * TILE + radius, column * TILE + pad, x, y, z, least)
        total = np.float32(0.0)
        for j in range(k):
            total += np.sqrt(least[j])
        out[v, u] = total / k


@njit(cache=True, fastmath=True)
def _box_distance2(boxes: Image, r: int, c: int, x: np.float32, y: np.float32, z: np.float32) -> np.float32:
    dx = max(boxes[r, c, 0] - x, x - boxes[r, c, 3], np.float32(0.0))
    dy = max(boxes[r, c, 1] - y, y - boxes[r, c, 4], np.float32(0.0))
    dz = max(boxes[r, c, 2] - z, z - boxes[r, c, 5], np.float32(0.0))
    distance2: np.float32 = dx * dx + dy * dy + dz * dz
    return distance2


@njit(cache=True, fastmath=True)
def _merge(cloud: Image, row: int, column: int, x: float, y: float, z: float, least: Image) -> None:
    """Merge a tile's points into the sorted least squared distances; what lies beyond the raster is nowhere."""
    last = least.size - 1
    for v in range(row, min(row + TILE, cloud.shape[1])):
        for u in range(column, column + TILE):
            dx, dy, dz = cloud[0, v, u] - x, cloud[1, v, u] - y, cloud[2, v, u] - z
            value = dx * dx + dy * dy + dz * dz
            if value < least[last]:
                j = last
                while j > 0 and least[j - 1] > value:
                    least[j] = least[j - 1]
                    j -= 1
                least[j] = value
