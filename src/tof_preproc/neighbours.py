# SPDX-License-Identifier: Apache-2.0
"""Mean distance of points to their nearest neighbours, searched in the raster instead of a tree.

A pixel r columns or rows away lies on a ray at least r pixels away, so its point is at least about z r pitch away,
whatever its depth. Once the k-th distance found is below that, no pixel further out can be nearer: the result is as
exact as that of a k-d tree. One window is enough for nearly all pixels, 64 of them at a time, wider ones for most of the
rest. The others search outwards, tile by tile, and skip the tiles whose bounds are further away.

Whether k points lie within a given distance is much cheaper to find: one count over a small window, no search.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numba import njit

from tof_preproc.tiles import NOWHERE, TILE, boxes, outwards, reach2

if TYPE_CHECKING:
    from tof_core.arrays import Float, Image, Ints, Mask
    from tof_core.camera import Camera

LANES = 64
"""Pixels that are worked on together."""
WINDOWS = (1.4, 1.9, 3.0)
"""Radii of the windows, one after the other, in radii of a disc that holds k pixels."""
DENSE = 1.22
"""Radius of the window that is counted, in the same unit: on a surface it holds half as many pixels again as are needed."""
WIDE = 2.4
"""Half the side of the square that is counted next: half of it, as at a straight rim, holds more than twice as many as are needed."""
STEPS = 6
"""Secant steps to the k-th distance."""


class Neighbourhood:
    """The points of a depth image (H, W), and the distances between them; `known` (H, W) where there is one, `points` how many.

    `k` nearest count, the point itself (at 0) among them, as Open3D counts; all of them where there are fewer.
    """

    def __init__(self, depth: Image, camera: Camera, k: int) -> None:
        """Points of all pixels that have a depth and a ray."""
        self._radii = [max(2, int(np.ceil(times * np.sqrt(k / np.pi)))) for times in WINDOWS]
        self._reach = max(1, round(DENSE * np.sqrt(k / np.pi)))
        self._wide = max(2, round(WIDE * np.sqrt(k / np.pi)))
        self._pad = max(*self._radii, TILE)  # a tile at the rim reaches beyond it
        self._pitch = _pitch(camera)
        self._boxes: Image | None = None
        self._cloud = np.empty((3, depth.shape[0] + 2 * self._pad, depth.shape[1] + 2 * self._pad), np.float32)
        self.points = _fill(self._cloud, depth, camera.rays(), self._pad)
        self.k = min(k, self.points)
        self.known = self._cloud[2, self._pad : -self._pad, self._pad : -self._pad] < NOWHERE

    def mean_distance(self, pixels: Ints) -> Image:
        """(n,) mean distance in metres of known pixels, given by their flat index (n,), to their k nearest points."""
        out = np.full(pixels.size, np.float32(-1.0))
        rest = np.arange(pixels.size)
        for radius in self._radii:
            _inside(self._cloud, self._pitch, self.k, radius, self._pad, pixels, rest, out)
            rest = rest[out[rest] < 0]
        if rest.size:
            if self._boxes is None:
                self._boxes = boxes(self._cloud, self._pad)
            outwards(self._cloud, self._boxes, self._pitch, self.k, self._pad, pixels, rest, out)
        return out

    def doubtful(self, within: Image, *, at_rims: bool = True) -> Ints:
        """(n,) flat indices of known pixels without k points closer than the distance `within` (H, W); elsewhere the mean is below it, too.

        A small window of pixels is looked at, and a wider one where that does not suffice, as at the rim of a surface (not with `at_rims`
        false, where most of them are too far from each other anyway): a pixel that is named may be as dense all the same.
        """
        rest = np.flatnonzero(self.known & ~_dense_there(self._cloud, within, self.k, self._reach, self._pad))
        if not at_rims:
            return rest
        return np.asarray(rest[~_dense_at(self._cloud, within.ravel(), self.k, self._wide, self._pad, rest)])


def mean_distance(depth: Image, camera: Camera, k: int) -> Image:
    """Mean distance (H, W) in metres to the k nearest points, the point itself (at 0) among them; NaN where there is no depth."""
    out = np.full(depth.shape, np.float32(np.nan))
    cloud = Neighbourhood(depth, camera, k)
    out[cloud.known] = cloud.mean_distance(np.flatnonzero(cloud.known))
    return out


@lru_cache(maxsize=16)
def _pitch(camera: Camera) -> float:
    """Least step between neighbouring rays at z = 1."""
    rays = camera.rays()
    steps = [np.abs(np.diff(rays[..., axis], axis=1 - axis)) for axis in (0, 1)]
    return float(min((np.nanmin(s) for s in steps if s.size), default=camera.pixel_angle))


@njit(cache=True)
def _fill(cloud: Image, depth: Image, rays: Float, pad: int) -> int:
    """Points (3, H + 2 pad, W + 2 pad) of a depth image; how many there are."""
    points = 0
    height, width = depth.shape
    for i in range(3):
        cloud[i, :pad], cloud[i, pad + height :] = NOWHERE, NOWHERE
        cloud[i, :, :pad], cloud[i, :, pad + width :] = NOWHERE, NOWHERE
    for v in range(height):
        for u in range(width):
            z, x, y = depth[v, u], rays[v, u, 0], rays[v, u, 1]
            known = np.isfinite(z) & np.isfinite(x) & np.isfinite(y)
            cloud[0, v + pad, u + pad] = np.float32(x * z if known else NOWHERE)
            cloud[1, v + pad, u + pad] = np.float32(y * z if known else NOWHERE)
            cloud[2, v + pad, u + pad] = z if known else np.float32(NOWHERE)
            points += 1 if known else 0
    return points


@njit(cache=True, fastmath=True)
def _dense_there(cloud: Image, within: Image, k: int, radius: int, pad: int) -> Mask:
    """Where at least k points of a disc of pixels lie within a distance (H, W)."""
    height, width = within.shape
    out = np.empty((height, width), np.bool_)
    limit2, n = np.empty(width, np.float32), np.empty(width, np.float32)
    for v in range(height):
        x, y, z = cloud[0, v + pad, pad : pad + width], cloud[1, v + pad, pad : pad + width], cloud[2, v + pad, pad : pad + width]
        n[:] = np.float32(0.0)
        limit2[:] = within[v] * within[v]
        for dv in range(v + pad - radius, v + pad + radius + 1):
            reach = int(np.sqrt(radius * (radius + 0.4) - (dv - v - pad) ** 2))
            for du in range(pad - reach, pad + reach + 1):
                xs, ys, zs = cloud[0, dv, du : du + width], cloud[1, dv, du : du + width], cloud[2, dv, du : du + width]
                for c in range(width):
                    dx, dy, dz = xs[c] - x[c], ys[c] - y[c], zs[c] - z[c]
                    n[c] += np.float32(1.0) if dx * dx + dy * dy + dz * dz <= limit2[c] else np.float32(0.0)
        for c in range(width):
            out[v, c] = n[c] >= k
    return out


@njit(cache=True, fastmath=True)
def _dense_at(cloud: Image, within: Image, k: int, radius: int, pad: int, pixels: Ints) -> Mask:
    """Where at least k points of a square of pixels lie within a distance (H W,), for some pixels (flat indices)."""
    width = cloud.shape[2] - 2 * pad
    out = np.empty(pixels.size, np.bool_)
    for i in range(pixels.size):
        v, u = pixels[i] // width + pad, pixels[i] % width + pad
        x, y, z, limit2 = cloud[0, v, u], cloud[1, v, u], cloud[2, v, u], within[pixels[i]] * within[pixels[i]]
        n = 0
        for row in range(v - radius, v + radius + 1):
            for column in range(u - radius, u + radius + 1):
                dx, dy, dz = cloud[0, row, column] - x, cloud[1, row, column] - y, cloud[2, row, column] - z
                n += 1 if dx * dx + dy * dy + dz * dz <= limit2 else 0
            if n >= k:
                break
        out[i] = n >= k
    return out


@njit(cache=True, fastmath=True, error_model="numpy")
def _inside(cloud: Image, pitch: float, k: int, radius: int, pad: int, pixels: Ints, rest: Ints, out: Image) -> None:
    """Fill `out` for those of the pixels (flat indices) named by `rest` whose window holds the k nearest."""
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
    width = cloud.shape[2] - 2 * pad
    for start in range(0, rest.size, LANES):
        lanes = min(LANES, rest.size - start)
        for c in range(lanes):
            p = pixels[rest[start + c]]
            reach2[c] = _window(cloud, p // width + pad, p % width + pad, radius, pitch, c, d2)
        for c in range(lanes, LANES):
            reach2[c] = reach2[0]
            d2[:, c] = d2[:, 0]
        _select(d2, k, reach2, mean, lo, n_lo, n_hi, guess, n, total)
        for c in range(lanes):
            out[rest[start + c]] = mean[c]


@njit(cache=True, fastmath=True)
def _window(cloud: Image, v: int, u: int, radius: int, pitch: float, lane: int, d2: Image) -> np.float32:
    """Squared distances d2[:, lane] of a pixel to all pixels of its window, and below which no others can be."""
    x, y, z = cloud[0, v, u], cloud[1, v, u], cloud[2, v, u]
    o = 0
    for row in range(v - radius, v + radius + 1):
        for column in range(u - radius, u + radius + 1):
            dx, dy, dz = cloud[0, row, column] - x, cloud[1, row, column] - y, cloud[2, row, column] - z
            d2[o, lane] = dx * dx + dy * dy + dz * dz
            o += 1
    nearer: np.float32 = reach2(x, y, z, pitch, radius)
    return nearer


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
