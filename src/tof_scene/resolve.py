# SPDX-License-Identifier: Apache-2.0
"""The surfaces in a pixel: its triangles are sampled at a lattice of points, nearest first, and the samples counted per surface."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numba import njit

from tof_scene.surfaces import fold, group_faces, surface_size, surface_sum, tally

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from tof_core.arrays import Bytes, Float, Image

    Int32 = NDArray[np.int32]
    Float32 = NDArray[np.float32]

ONE = np.float32(1.0)
SLACK = np.float32(1e-6)
LATTICES = ((89, 55), (377, 233), (987, 610))
"""Samples and generator of the lattices for pixels with one bent surface, with an edge, and with two surfaces."""
CREASE_M = 8e-6
"""Error of the mean depth beyond which the second lattice is taken; across a crease it is about (difference of the slopes) / (2 x samples)."""


def lattice(n: int, generator: int) -> Float32:
    """(2, n) points in the unit pixel around (0, 0): Fibonacci's lattice.

    987 points count half-planes to 0.13 % rms (0.06 % for half-planes along the axes, common for edges of CAD; a square grid of 1024
    points is off by 0.8 % there).
    """
    i = np.arange(n)
    return np.stack([(i + 0.5) / n - 0.5, (i * generator + 0.5) / n % 1 - 0.5]).astype(np.float32)


@njit(cache=True, nogil=True)
def resolve(
    begin: int, end: int, pixels: NDArray[np.int64], edge: Bytes, start: Int32, listed: Int32, rows: Float, rays: Float, turn: Float,
    part: NDArray[np.int16], lattices: tuple[Float32, Float32, Float32], depth: Image, face: Int32, mixed: Image, second: Image,
) -> None:  # fmt: skip
    """Fill depth, face, mixed and second (flat over pixels) of the pixels numbered begin..end of `pixels` (k,).

    `edge` (k,) is the first of the three `lattices` to try, 1 or 2; a pixel with two surfaces goes on to the last lattice, one with a
    sharp crease to the second. `start`, `listed` and `rows` come from `overlaps`; `rays` and `turn` (k, ...) belong to `pixels`. `face`
    is kept where that face belongs to the largest surface. A pixel with more void samples than samples on any surface gets NaN.
    """
    most = 1
    for k in range(begin, end):
        most = max(most, start[k + 1] - start[k])
    planes, nearest = np.empty((most, 9), np.float32), np.empty(most, np.float32)
    inverse, owner = np.empty(lattices[2].shape[1], np.float32), np.empty(lattices[2].shape[1], np.int32)
    depths, marks, sums = np.empty((most, 3)), np.empty((most, 3)), np.empty((most, 3), np.float32)
    order, count, seen, group = np.empty(most, np.int32), np.empty(most, np.int32), np.empty(most, np.int32), np.empty(most, np.int32)
    for k in range(begin, end):
        candidates = listed[start[k] : start[k + 1]]
        _prepare(candidates, k, rows, rays, turn, planes, nearest)
        _nearest_first(len(candidates), nearest, order)
        surfaces = found = void = n = 0
        for level in range(edge[k] - 1, 3):
            samples = lattices[level]
            n = samples.shape[1]
            drawn = _sample(order[: len(candidates)], planes, nearest, samples, inverse[:n], owner[:n])
            found, void = tally(inverse[:n], owner[:n], order[:drawn], count, sums, depths, seen)
            surfaces = group_faces(n, found, seen, candidates, planes, part, depths, group, marks)
            if surfaces == 1 and void == 0 and (level or fold(found, seen, planes, depths) < CREASE_M * n):
                break
        _write(pixels[k], candidates, n, void, found, surfaces, seen, group, count, depths, depth, face, mixed, second)


@njit(cache=True, nogil=True)
def _prepare(candidates: Int32, k: int, rows: Float, rays: Float, turn: Float, planes: Float32, nearest: Float32) -> None:
    """Per candidate its barycentric functions over the pixel (constant, per u, per v), and a lower bound of its depth."""
    for c in range(len(candidates)):
        f, top, per_u, per_v = candidates[c], 0.0, 0.0, 0.0
        for i in range(3):
            x, y = rows[f, i, 0], rows[f, i, 1]
            at = x * rays[k, 0] + y * rays[k, 1] + rows[f, i, 2]
            u, v = x * turn[k, 0] + y * turn[k, 1], x * turn[k, 2] + y * turn[k, 3]
            planes[c, 3 * i], planes[c, 3 * i + 1], planes[c, 3 * i + 2] = at, u, v
            top, per_u, per_v = top + at, per_u + u, per_v + v
        top += 0.5 * (abs(per_u) + abs(per_v))
        nearest[c] = 1.0 / top if top > 0.0 else np.inf


@njit(cache=True, nogil=True)
def _nearest_first(n: int, nearest: Float32, order: Int32) -> None:
    """Candidates by depth, by insertion sort, since there are about a dozen."""
    for c in range(n):
        at = c
        while at > 0 and nearest[order[at - 1]] > nearest[c]:
            order[at] = order[at - 1]
            at -= 1
        order[at] = c


@njit(cache=True, nogil=True)
def _sample(order: Int32, planes: Float32, nearest: Float32, samples: Float32, inverse: Float32, owner: Int32) -> int:
    """Nearest candidate and its 1/z at each sample; stops once all further candidates lie behind. Returns the number drawn."""
    inverse[:] = 0.0
    owner[:] = -1
    for drawn in range(len(order)):
        c = order[drawn]
        if nearest[c] == np.inf or _all_nearer(inverse, nearest[c]):
            return drawn
        _cover(planes, c, samples, inverse, owner)
    return len(order)


@njit(cache=True, nogil=True)
def _all_nearer(inverse: Float32, z: np.float32) -> bool:
    """Whether all samples are nearer than z."""
    n = len(inverse)
    for s in (0, n // 3, 2 * n // 3, n - 1):  # far apart: a cheap test before that of all samples
        if not inverse[s] * z > ONE:
            return False
    nearer = np.int32(0)
    for s in range(n):
        nearer += np.int32(inverse[s] * z > ONE)  # counted: a loop that may end early is not vectorised
    return bool(nearer == n)


@njit(cache=True, nogil=True, fastmath=True)
def _cover(planes: Float32, c: np.int32, samples: Float32, inverse: Float32, owner: Int32) -> None:
    """Draw one triangle into the samples at which it is nearest."""
    su, sv = samples[0], samples[1]
    a0, a1, a2 = planes[c, 0], planes[c, 1], planes[c, 2]
    b0, b1, b2 = planes[c, 3], planes[c, 4], planes[c, 5]
    c0, c1, c2 = planes[c, 6], planes[c, 7], planes[c, 8]
    slack = -SLACK * (abs(a0) + abs(b0) + abs(c0) + abs(a1) + abs(b1) + abs(c1) + abs(a2) + abs(b2) + abs(c2))
    # Zero, which the compiler does not know: a value that it knows to be unchanged is written with a mask, which takes twice as long.
    zero = np.int32(len(su) >> 30)
    for s in range(len(su)):
        a = a0 + a1 * su[s] + a2 * sv[s]
        b = b0 + b1 * su[s] + b2 * sv[s]
        d = c0 + c1 * su[s] + c2 * sv[s]
        w = a + b + d
        so_far, of = inverse[s] + np.float32(zero), owner[s] + zero
        nearer = (a >= slack) & (b >= slack) & (d >= slack) & (w > so_far)
        inverse[s] = w if nearer else so_far
        owner[s] = c if nearer else of


@njit(cache=True, nogil=True)
def _write(
    pixel: int, candidates: Int32, n: int, void: int, found: int, surfaces: int, seen: Int32, group: Int32, count: Int32, depths: Float,
    depth: Image, face: Int32, mixed: Image, second: Image,
) -> None:  # fmt: skip
    """The largest surface gives the pixel's depth, the second largest the share and depth of the second surface."""
    first, other, largest, next_largest = -1, -1, 0, 0
    for g in range(surfaces):
        size = surface_size(g, found, seen, group, count)
        if size > largest:
            other, next_largest, first, largest = first, largest, g, size
        elif size > next_largest:
            other, next_largest = g, size
    if largest < max(void, 1):
        if void < n or face[pixel] < 0:  # where all samples miss, a hit of the centre ray counts
            depth[pixel], face[pixel] = np.nan, -1
        return
    depth[pixel] = surface_sum(first, found, seen, group, depths) / largest
    face[pixel] = _front(first, found, seen, group, count, candidates, face[pixel])
    if next_largest:
        mixed[pixel] = next_largest / n
        second[pixel] = surface_sum(other, found, seen, group, depths) / next_largest


@njit(cache=True, nogil=True)
def _front(g: int, found: int, seen: Int32, group: Int32, count: Int32, candidates: Int32, centre: int) -> Any:
    """The face that represents a surface: the one at the pixel's centre, else the one with most samples."""
    best = -1
    for i in range(found):
        if group[i] == g:
            if candidates[seen[i]] == centre:
                return centre
            if best < 0 or count[seen[i]] > count[best]:
                best = seen[i]
    return candidates[best]
