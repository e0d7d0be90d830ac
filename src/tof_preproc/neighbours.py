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

from tof_preproc.tiles import NOWHERE, TILE, boxes, outwards
from tof_preproc.windows import BEYOND, UNDECIDED, inside, judge

if TYPE_CHECKING:
    from tof_core.arrays import Float, Image, Ints, Mask
    from tof_core.camera import Camera

WINDOWS = (1.4, 1.9, 3.0)
"""Radii of the windows, one after the other, in radii of a disc that holds k pixels."""
DENSE = 1.22
"""Radius of the window that is counted, in the same unit: on a surface it holds 1.5 times the pixels that are needed."""
WIDE = 2.4
"""Half the side of the square that is counted next: half of it, as at a straight rim, holds more than twice as many as are needed."""


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
        self.points = _fill(self._cloud, depth, *rays_at_1(camera), self._pad)
        self.k = min(k, self.points)
        self.known = self._cloud[2, self._pad : -self._pad, self._pad : -self._pad] < NOWHERE

    def mean_distance(self, pixels: Ints, at_least: float = 0.0) -> Image:
        """(n,) mean distance in metres of known pixels, given by their flat index (n,), to their k nearest points.

        at_least: lower bound in metres of the distance to the k-th; smaller windows are left out.
        """
        out = self.mean_distance_near(pixels, at_least)
        rest = np.flatnonzero(out < 0)
        self._search_outwards(pixels, rest, out)
        return out

    def mean_distance_near(self, pixels: Ints, at_least: float = 0.0) -> Image:
        """As `mean_distance`, but -1 where the k nearest reach beyond the widest window."""
        out = np.full(pixels.size, np.float32(-1.0))
        rest = np.arange(pixels.size)
        for radius in self._radii:
            tried = rest if at_least <= 0.0 else rest[self._reaches(radius, pixels[rest]) >= at_least]
            inside(self._cloud, self._pitch, self.k, radius, self._pad, pixels, tried, out)
            rest = rest[out[rest] < 0]
        return out

    def beyond(self, pixels: Ints, limit: Image) -> Mask:
        """(n,) whether the mean distance of known pixels (flat indices (n,)) to their k nearest points is at least a limit (n,) in metres.

        For most pixels no search is needed. The k nearest points within a window give an upper bound of the mean; the reach of the
        window gives a lower bound. The mean is computed only where the limit lies between the two.
        """
        verdict = np.full(pixels.size, UNDECIDED, np.int8)
        rest = np.arange(pixels.size)
        for radius in self._radii:
            judge(self._cloud, self._pitch, self.k, radius, self._pad, pixels, rest, limit, verdict)
            rest = rest[verdict[rest] == UNDECIDED]
        distance = np.empty(pixels.size, np.float32)
        self._search_outwards(pixels, rest, distance)
        verdict[rest] = ~(distance[rest] < limit[rest])
        return np.asarray(verdict == BEYOND)

    def _search_outwards(self, pixels: Ints, rest: Ints, out: Image) -> None:
        """Fill `out` for those pixels that `rest` names, tile by tile."""
        if rest.size:
            if self._boxes is None:
                self._boxes = boxes(self._cloud, self._pad)
            outwards(self._cloud, self._boxes, self._pitch, self.k, self._pad, pixels, rest, out)

    def _reaches(self, radius: int, pixels: Ints) -> Float:
        """(n,) distance in metres below which no point outside the window of a pixel can be."""
        row, column = np.divmod(pixels, self.known.shape[1])
        points = self._cloud[:, row + self._pad, column + self._pad].astype(float)
        off = (radius + 1) * self._pitch
        return np.asarray(points[2] * off / (np.sqrt((points * points).sum(axis=0)) / points[2] + off))

    def doubtful(self, within: Image, *, at_rims: bool = True) -> Ints:
        """(n,) flat indices of known pixels without k points closer than the distance `within` (H, W); elsewhere the mean is below it, too.

        A small window of pixels is counted, and a wider one where that does not suffice, as at the rim of a surface (not if `at_rims` is
        false). The windows are limited, so a pixel that is returned may have k such points all the same.
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
def rays_at_1(camera: Camera) -> tuple[Image, Image]:
    """(H, W) x and y of the rays with z = 1, as float32."""
    rays = camera.rays()
    return np.ascontiguousarray(rays[..., 0], np.float32), np.ascontiguousarray(rays[..., 1], np.float32)


@lru_cache(maxsize=16)
def _pitch(camera: Camera) -> float:
    """Least step between neighbouring rays at z = 1."""
    rays = camera.rays()
    steps = [np.abs(np.diff(rays[..., axis], axis=1 - axis)) for axis in (0, 1)]
    return float(min((np.nanmin(s) for s in steps if s.size), default=camera.pixel_angle))


@njit(cache=True)
def _fill(cloud: Image, depth: Image, x: Image, y: Image, pad: int) -> int:
    """Points (3, H + 2 pad, W + 2 pad) of a depth image by the rays' x and y at z = 1 (H, W); how many there are.

    Row by row without a branch, so that the compiler works on eight pixels with one instruction.
    """
    points = 0
    height, width = depth.shape
    for i in range(3):
        cloud[i, :pad], cloud[i, pad + height :] = NOWHERE, NOWHERE
        cloud[i, :, :pad], cloud[i, :, pad + width :] = NOWHERE, NOWHERE
    for v in range(height):
        z, to = depth[v], cloud[2, v + pad, pad : pad + width]
        seen = np.float32(0.0)
        for u in range(width):
            known = np.isfinite(z[u] * (x[v, u] + y[v, u]))
            to[u] = z[u] if known else np.float32(NOWHERE)
        _along(to, x[v], cloud[0, v + pad, pad : pad + width])
        _along(to, y[v], cloud[1, v + pad, pad : pad + width])
        for u in range(width):
            seen += np.float32(1.0) if to[u] < NOWHERE else np.float32(0.0)
        points += int(seen)
    return points


@njit(cache=True)
def _along(z: Image, rays: Image, out: Image) -> None:
    """One coordinate of a row of points."""
    for u in range(z.size):
        point = z[u] * rays[u]
        out[u] = point if z[u] < NOWHERE else np.float32(NOWHERE)


@njit(cache=True, fastmath=True)
def _dense_there(cloud: Image, within: Image, k: int, radius: int, pad: int) -> Mask:
    """Where at least k points of a disc of pixels lie within a distance (H, W)."""
    height, width = within.shape
    out = np.empty((height, width), np.bool_)
    limit2, n = np.empty(width, np.float32), np.empty(width, np.float32)
    for v in range(height):
        x, y, z = cloud[0, v + pad, pad : pad + width], cloud[1, v + pad, pad : pad + width], cloud[2, v + pad, pad : pad + width]
        n[:] = np.float32(0.0)
        for c in range(width):
            limit2[c] = within[v, c] * within[v, c]
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
        for step in range(2 * radius + 1):  # from the middle row outwards: there the nearest are
            row = v + (step + 1) // 2 if step % 2 else v - step // 2
            for column in range(u - radius, u + radius + 1):
                dx, dy, dz = cloud[0, row, column] - x, cloud[1, row, column] - y, cloud[2, row, column] - z
                n += 1 if dx * dx + dy * dy + dz * dz <= limit2 else 0
            if n >= k:
                break
        out[i] = n >= k
    return out
