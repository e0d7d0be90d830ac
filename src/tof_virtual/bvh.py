# SPDX-License-Identifier: Apache-2.0
"""The virtual camera's own ray caster: a bounding-volume hierarchy over triangles, float64, compiled by Numba.

Binned surface-area heuristic (Wald 2007) and Moeller-Trumbore with edges that belong to both neighbours, so that
no ray slips between two triangles that share an edge. Single-threaded: cases run side by side.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numba import njit

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from tof_core.arrays import Float, Mask

LEAF = 3
"""Triangles at which a node is no longer split."""
BINS = 12
EDGE = 1e-9
"""Slack on barycentric coordinates at an edge."""


@dataclass(frozen=True, slots=True, eq=False)
class Bvh:
    """Boxes (n, 6) low then high; links (n, 2): (left child, -1) or (first triangle, count > 0); triangles (m, 9) v0 e1 e2."""

    boxes: Float
    links: NDArray[np.int32]
    triangles: Float
    order: NDArray[np.int32]

    def cast(self, origins: Float, directions: Float) -> tuple[Float, NDArray[np.int32]]:
        """First hit of rays (N, 3): multiples of the direction (N,), NaN for a miss, and faces (N,), -1 for a miss.

        `origins` may be one point (3,) for all rays.
        """
        directions = np.ascontiguousarray(directions, float)
        # One point for one ray stays read-only where it is broadcast, and a kernel is compiled again for read-only arrays.
        origins = np.require(np.broadcast_to(origins, directions.shape), float, ["C", "W"])
        t, face = _cast(self.boxes, self.links, self.triangles, origins, directions)
        face = np.where(face >= 0, self.order[face], -1).astype(np.int32)
        return t, face

    def blocked(self, start: Float, end: Float) -> Mask:
        """Whether a triangle lies between points (N, 3) and (N, 3), both ends shortened slightly."""
        return np.asarray(
            _blocked(self.boxes, self.links, self.triangles, np.ascontiguousarray(start, float), np.ascontiguousarray(end, float))
        )


def build(corners: Float) -> Bvh:
    """Hierarchy over triangles (m, 3, 3)."""
    corners = np.ascontiguousarray(corners, float)
    boxes, links, order = _build(corners.min(axis=1), corners.max(axis=1))
    v0 = corners[order, 0]
    triangles = np.concatenate([v0, corners[order, 1] - v0, corners[order, 2] - v0], axis=1)
    return Bvh(boxes, links, np.ascontiguousarray(triangles), order)


@njit(cache=True)
def _area(lo: Float, hi: Float) -> float:
    x, y, z = hi[0] - lo[0], hi[1] - lo[1], hi[2] - lo[2]
    return float(x * y + y * z + z * x)


@njit(cache=True)
def _split(lo: Float, hi: Float, order: NDArray[np.int32], first: int, count: int) -> int:
    """Partition order[first : first + count] at the cheapest of the binned planes; the left half's size, 0 for a leaf."""
    centre_lo, centre_hi = np.full(3, np.inf), np.full(3, -np.inf)
    for i in range(first, first + count):
        for a in range(3):
            c = lo[order[i], a] + hi[order[i], a]
            centre_lo[a] = min(centre_lo[a], c)
            centre_hi[a] = max(centre_hi[a], c)
    axis = int(np.argmax(centre_hi - centre_lo))
    span = centre_hi[axis] - centre_lo[axis]
    if span <= 1e-12:
        return count // 2 if count > 8 else 0
    scale = BINS * (1 - 1e-9) / span
    bin_lo, bin_hi = np.full((BINS, 3), np.inf), np.full((BINS, 3), -np.inf)
    number = np.zeros(BINS, np.int64)
    for i in range(first, first + count):
        t = order[i]
        b = int((lo[t, axis] + hi[t, axis] - centre_lo[axis]) * scale)
        number[b] += 1
        for a in range(3):
            bin_lo[b, a] = min(bin_lo[b, a], lo[t, a])
            bin_hi[b, a] = max(bin_hi[b, a], hi[t, a])
    cost = np.full(BINS, np.inf)
    side_lo, side_hi, n = np.full(3, np.inf), np.full(3, -np.inf), 0
    for b in range(BINS - 1):
        side_lo, side_hi, n = np.minimum(side_lo, bin_lo[b]), np.maximum(side_hi, bin_hi[b]), n + number[b]
        cost[b] = n * _area(side_lo, side_hi) if 0 < n < count else np.inf
    side_lo, side_hi, n = np.full(3, np.inf), np.full(3, -np.inf), 0
    for b in range(BINS - 1, 0, -1):
        side_lo, side_hi, n = np.minimum(side_lo, bin_lo[b]), np.maximum(side_hi, bin_hi[b]), n + number[b]
        cost[b - 1] += n * _area(side_lo, side_hi) if 0 < n < count else np.inf
    best = int(np.argmin(cost))
    i, j = first, first + count - 1
    while i <= j:
        t = order[i]
        if int((lo[t, axis] + hi[t, axis] - centre_lo[axis]) * scale) <= best:
            i += 1
        else:
            order[i], order[j] = order[j], order[i]
            j -= 1
    return i - first


@njit(cache=True)
def _build(lo: Float, hi: Float) -> tuple[Float, NDArray[np.int32], NDArray[np.int32]]:
    m = lo.shape[0]
    order = np.arange(m).astype(np.int32)
    boxes = np.empty((2 * m + 1, 6))
    links = np.empty((2 * m + 1, 2), np.int32)
    todo = np.empty((2 * m + 1, 3), np.int64)
    todo[0, 0], todo[0, 1], todo[0, 2] = 0, 0, m
    waiting, nodes = 1, 1
    while waiting > 0:
        waiting -= 1
        node, first, count = todo[waiting]
        boxes[node, :3], boxes[node, 3:] = np.inf, -np.inf
        for i in range(first, first + count):
            for a in range(3):
                boxes[node, a] = min(boxes[node, a], lo[order[i], a])
                boxes[node, 3 + a] = max(boxes[node, 3 + a], hi[order[i], a])
        left = _split(lo, hi, order, first, count) if count > LEAF else 0
        if left == 0:
            links[node, 0], links[node, 1] = first, count
            continue
        links[node, 0], links[node, 1] = nodes, 0
        todo[waiting, 0], todo[waiting, 1], todo[waiting, 2] = nodes, first, left
        todo[waiting + 1, 0], todo[waiting + 1, 1], todo[waiting + 1, 2] = nodes + 1, first + left, count - left
        waiting += 2
        nodes += 2
    return boxes[:nodes].copy(), links[:nodes].copy(), order


@njit(cache=True, inline="always", error_model="numpy")
def _enter(boxes: Float, node: int, ox: float, oy: float, oz: float, ix: float, iy: float, iz: float, far: float) -> float:
    """Where the ray enters a box, inf where it misses it or comes later than `far`."""
    a, b = (boxes[node, 0] - ox) * ix, (boxes[node, 3] - ox) * ix
    near = min(a, b)
    last = max(a, b)
    a, b = (boxes[node, 1] - oy) * iy, (boxes[node, 4] - oy) * iy
    near = max(near, min(a, b))
    last = min(last, max(a, b))
    a, b = (boxes[node, 2] - oz) * iz, (boxes[node, 5] - oz) * iz
    near = max(near, min(a, b))
    last = min(last, max(a, b))
    if last * (1 + 1e-12) >= near and last >= 0.0 and near <= far:
        return float(near)
    return np.inf


@njit(cache=True, inline="always", error_model="numpy")
def _meet(tri: Float, i: int, ox: float, oy: float, oz: float, dx: float, dy: float, dz: float) -> float:
    """Multiple of the direction at which the ray meets a triangle, inf if it does not."""
    ax, ay, az = tri[i, 3], tri[i, 4], tri[i, 5]
    bx, by, bz = tri[i, 6], tri[i, 7], tri[i, 8]
    px, py, pz = dy * bz - dz * by, dz * bx - dx * bz, dx * by - dy * bx
    det = ax * px + ay * py + az * pz
    if det == 0.0:
        return np.inf
    inv = 1.0 / det
    sx, sy, sz = ox - tri[i, 0], oy - tri[i, 1], oz - tri[i, 2]
    u = (sx * px + sy * py + sz * pz) * inv
    if u < -EDGE or u > 1 + EDGE:
        return np.inf
    qx, qy, qz = sy * az - sz * ay, sz * ax - sx * az, sx * ay - sy * ax
    v = (dx * qx + dy * qy + dz * qz) * inv
    if v < -EDGE or u + v > 1 + EDGE:
        return np.inf
    t = (bx * qx + by * qy + bz * qz) * inv
    return float(t) if t > 0.0 else np.inf


@njit(cache=True, inline="always")
def _inverse(x: float) -> float:
    return 1.0 / x if abs(x) > 1e-200 else 1e200


@njit(cache=True, error_model="numpy")
def _cast(boxes: Float, links: NDArray[np.int32], tri: Float, origins: Float, directions: Float) -> tuple[Float, NDArray[np.int32]]:
    n = directions.shape[0]
    t_out = np.full(n, np.nan)
    face = np.full(n, -1, np.int32)
    stack = np.empty(96, np.int32)
    entry = np.empty(96)
    hint = -1
    for r in range(n):
        ox, oy, oz = origins[r, 0], origins[r, 1], origins[r, 2]
        dx, dy, dz = directions[r, 0], directions[r, 1], directions[r, 2]
        if not np.isfinite(dx + dy + dz):
            continue
        ix, iy, iz = _inverse(dx), _inverse(dy), _inverse(dz)
        best, hit = np.inf, -1
        if hint >= 0:  # the neighbour's triangle is often this ray's too, and then prunes most of the tree
            t = _meet(tri, hint, ox, oy, oz, dx, dy, dz)
            if t < best:
                best, hit = t, hint
        stack[0], entry[0], top = 0, _enter(boxes, 0, ox, oy, oz, ix, iy, iz, best), 1
        while top > 0:
            top -= 1
            node = stack[top]
            if not entry[top] <= best or entry[top] == np.inf:
                continue
            while links[node, 1] == 0:
                left = links[node, 0]
                right = left + 1
                t_left = _enter(boxes, left, ox, oy, oz, ix, iy, iz, best)
                t_right = _enter(boxes, right, ox, oy, oz, ix, iy, iz, best)
                if t_right < t_left:
                    left, right = right, left
                    t_left, t_right = t_right, t_left
                if t_left == np.inf:
                    node = -1
                    break
                if t_right != np.inf:
                    stack[top], entry[top] = right, t_right
                    top += 1
                node = left
            if node < 0:
                continue
            first = links[node, 0]
            for i in range(first, first + links[node, 1]):
                t = _meet(tri, i, ox, oy, oz, dx, dy, dz)
                if t < best:
                    best, hit = t, i
        if hit >= 0:
            t_out[r], face[r] = best, hit
        hint = hit
    return t_out, face


@njit(cache=True, error_model="numpy")
def shadow(
    boxes: Float,
    links: NDArray[np.int32],
    tri: Float,
    stack: NDArray[np.int32],
    hint: int,
    ox: float,
    oy: float,
    oz: float,
    dx: float,
    dy: float,
    dz: float,
) -> int:
    """A triangle that cuts the stretch from o to o + d, both ends pulled in by a hair; -1 if none. Tries `hint` first."""
    near, far = 1e-5, 1 - 1e-5
    if hint >= 0 and near < _meet(tri, hint, ox, oy, oz, dx, dy, dz) < far:
        return hint
    ix, iy, iz = _inverse(dx), _inverse(dy), _inverse(dz)
    stack[0], top = 0, 1
    while top > 0:
        top -= 1
        node = stack[top]
        if _enter(boxes, node, ox, oy, oz, ix, iy, iz, far) == np.inf:
            continue
        first = links[node, 0]
        if links[node, 1] == 0:
            stack[top], stack[top + 1] = first, first + 1
            top += 2
            continue
        for i in range(first, first + links[node, 1]):
            if near < _meet(tri, i, ox, oy, oz, dx, dy, dz) < far:
                return int(i)
    return -1


@njit(cache=True, error_model="numpy")
def _blocked(boxes: Float, links: NDArray[np.int32], tri: Float, start: Float, end: Float) -> Mask:
    out = np.zeros(start.shape[0], np.bool_)
    stack = np.empty(96, np.int32)
    hint = np.int64(-1)
    for r in range(start.shape[0]):
        d = end[r] - start[r]
        found = shadow(boxes, links, tri, stack, hint, start[r, 0], start[r, 1], start[r, 2], d[0], d[1], d[2])
        out[r] = found >= 0
        hint = found if found >= 0 else hint
    return out
