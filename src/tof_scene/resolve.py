# SPDX-License-Identifier: Apache-2.0
"""What fills a pixel: its triangles sampled at a lattice of points, nearest first, and the samples counted per surface."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numba import njit

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from tof_core.arrays import Float, Image

    Int32 = NDArray[np.int32]
    Float32 = NDArray[np.float32]

SAMPLES = 377
STEP_M = 1e-3
"""Within one part, what lies further apart than this along z (and than its slant explains) is another surface."""
SLANT = np.float32(0.15)
"""Share of a face's depth range in a pixel that may lie between neighbouring samples of it."""
ONE = np.float32(1.0)
SLACK = np.float32(1e-6)


def lattice(n: int = SAMPLES, generator: int = 233) -> Float32:
    """(2, n) points in the unit pixel around (0, 0): Fibonacci's lattice.

    Half-planes are counted to 0.3 % rms (a square grid of as many points: 0.3 % across, but 1.3 % along its axes, and
    edges of CAD often lie along the axes of the image).
    """
    i = np.arange(n)
    return np.stack([(i + 0.5) / n - 0.5, (i * generator + 0.5) / n % 1 - 0.5]).astype(np.float32)


@njit(cache=True, nogil=True)
def resolve(
    begin: int, end: int, start: Int32, listed: Int32, rows: Float, rays: Float, turn: Float, part: NDArray[np.int16], samples: Float32,
    pixels: NDArray[np.int64], depth: Image, face: Int32, mixed: Image, second: Image,
) -> None:  # fmt: skip
    """Fill depth, face, mixed and second (flat over pixels) of the pixels numbered begin..end of `pixels`.

    `start`, `listed` and `rows` come from `overlaps`, `rays` and `turn` (k, ...) belong to `pixels`. `face` keeps what it holds
    where that face belongs to the surface that fills most. A pixel more of whose samples are void than on any surface gets NaN.
    """
    n = samples.shape[1]
    inverse, owner = np.empty(n, np.float32), np.empty(n, np.int32)
    for k in range(begin, end):
        candidates = listed[start[k] : start[k + 1]]
        planes, nearest = _planes(candidates, rows, rays[k], turn[k])
        order = np.argsort(nearest)
        _sample(order, planes, nearest, samples, inverse, owner)
        _count(pixels[k], candidates, planes, part, inverse, owner, depth, face, mixed, second)


@njit(cache=True, nogil=True)
def _planes(candidates: Int32, rows: Float, ray: Float, turn: Float) -> tuple[Float32, Float32]:
    """Per candidate its three barycentric functions over the pixel (constant, per u, per v), and a depth nothing of it is nearer than."""
    planes = np.empty((len(candidates), 9), np.float32)
    nearest = np.empty(len(candidates), np.float32)
    for c in range(len(candidates)):
        top = 0.0
        for i in range(3):
            row = rows[candidates[c], i]
            at = row[0] * ray[0] + row[1] * ray[1] + row[2]
            per_u, per_v = row[0] * turn[0] + row[1] * turn[1], row[0] * turn[2] + row[1] * turn[3]
            planes[c, 3 * i], planes[c, 3 * i + 1], planes[c, 3 * i + 2] = at, per_u, per_v
            top += at
        swing = abs(planes[c, 1] + planes[c, 4] + planes[c, 7]) + abs(planes[c, 2] + planes[c, 5] + planes[c, 8])
        nearest[c] = 1.0 / (top + 0.5 * swing) if top + 0.5 * swing > 0.0 else np.inf
    return planes, nearest


@njit(cache=True, nogil=True)
def _sample(order: NDArray[np.int64], planes: Float32, nearest: Float32, samples: Float32, inverse: Float32, owner: Int32) -> None:
    """Nearest candidate and its 1/z at each sample; stops when all that is left lies behind what was found."""
    inverse[:] = 0.0
    owner[:] = -1
    for c in order:
        if nearest[c] == np.inf or nearest[c] * inverse.min() > ONE:
            return
        _cover(planes[c], np.int32(c), samples[0], samples[1], inverse, owner)


@njit(cache=True, nogil=True, fastmath=True)
def _cover(plane: Float32, c: np.int32, su: Float32, sv: Float32, inverse: Float32, owner: Int32) -> None:
    """Draw one triangle into the samples it is nearest at."""
    a0, a1, a2, b0, b1, b2, c0, c1, c2 = plane
    slack = -SLACK * (abs(a0) + abs(b0) + abs(c0) + abs(a1) + abs(b1) + abs(c1) + abs(a2) + abs(b2) + abs(c2))
    for s in range(len(su)):
        a = a0 + a1 * su[s] + a2 * sv[s]
        b = b0 + b1 * su[s] + b2 * sv[s]
        d = c0 + c1 * su[s] + c2 * sv[s]
        w = a + b + d
        inside = (min(min(a, b), d) >= slack) & (w > inverse[s])
        inverse[s] = w if inside else inverse[s]
        owner[s] = c if inside else owner[s]


@njit(cache=True, nogil=True)
def _count(
    pixel: int, candidates: Int32, planes: Float32, part: NDArray[np.int16], inverse: Float32, owner: Int32, depth: Image, face: Int32,
    mixed: Image, second: Image,
) -> None:  # fmt: skip
    """Samples to surfaces: the largest gives the pixel's depth, the next its share and depth."""
    seen, count, total, low, high = _per_face(len(candidates), inverse, owner)
    group = _surfaces(seen, candidates, planes, part, low, high)
    size = np.zeros(len(seen) + 1, np.int32)
    for i in range(len(seen)):
        size[group[i]] += count[seen[i]]
    void = len(owner) - size.sum()
    first = np.argmax(size)
    if size[first] < max(void, 1):
        if void < len(owner) or face[pixel] < 0:  # a centre ray that hit where all samples miss is believed
            depth[pixel], face[pixel] = np.nan, -1
        return
    depth[pixel] = _mean(first, group, seen, total, size)
    face[pixel] = _front(first, group, seen, count, candidates, face[pixel])
    share = size[first]
    size[first] = 0
    other = np.argmax(size)
    mixed[pixel] = min(np.float32(size[other]) / np.float32(len(owner)), np.float32(0.5))
    if size[other]:
        second[pixel] = _mean(other, group, seen, total, size)
    size[first] = share


@njit(cache=True, nogil=True)
def _per_face(n: int, inverse: Float32, owner: Int32) -> tuple[Int32, Int32, Float, Float32, Float32]:
    """Candidates that are seen, and per candidate: samples, sum of z, nearest and farthest z."""
    count, total = np.zeros(n, np.int32), np.zeros(n)
    low, high = np.full(n, np.inf, np.float32), np.zeros(n, np.float32)
    for s in range(len(owner)):
        c = owner[s]
        if c >= 0:
            z = ONE / inverse[s]
            count[c] += 1
            total[c] += z
            low[c], high[c] = min(low[c], z), max(high[c], z)
    return np.flatnonzero(count).astype(np.int32), count, total, low, high


@njit(cache=True, nogil=True)
def _surfaces(seen: Int32, candidates: Int32, planes: Float32, part: NDArray[np.int16], low: Float32, high: Float32) -> Int32:
    """Surface of each seen candidate: faces of one part whose depths in the pixel follow on each other."""
    group = np.zeros(len(seen), np.int32)
    order = np.argsort(low[seen])
    groups = 0
    owner, far, slant = np.empty(len(seen), np.int32), np.empty(len(seen), np.float32), np.empty(len(seen), np.float32)
    for i in order:
        c = seen[i]
        p, w = planes[c], planes[c, 0] + planes[c, 3] + planes[c, 6]
        lean = (abs(p[1] + p[4] + p[7]) + abs(p[2] + p[5] + p[8])) * low[c] * low[c] if w > 0 else np.float32(0)
        g = 0
        while g < groups and not (owner[g] == part[candidates[c]] and low[c] - far[g] <= max(STEP_M, SLANT * max(lean, slant[g]))):
            g += 1
        if g == groups:
            owner[g], far[g], slant[g] = part[candidates[c]], high[c], lean
            groups += 1
        group[i], far[g], slant[g] = g, max(far[g], high[c]), max(slant[g], lean)
    return group


@njit(cache=True, nogil=True)
def _mean(g: int, group: Int32, seen: Int32, total: Float, size: Int32) -> float:
    """Mean z of a surface's samples."""
    z = 0.0
    for i in range(len(seen)):
        if group[i] == g:
            z += total[seen[i]]
    return z / size[g]


@njit(cache=True, nogil=True)
def _front(g: int, group: Int32, seen: Int32, count: Int32, candidates: Int32, centre: int) -> int:
    """The face that stands for a surface: the one at the pixel's centre, else the one with most samples."""
    best = -1
    for i in range(len(seen)):
        if group[i] == g:
            if candidates[seen[i]] == centre:
                return centre
            if best < 0 or count[seen[i]] > count[seen[best]]:
                best = i
    return candidates[seen[best]]
