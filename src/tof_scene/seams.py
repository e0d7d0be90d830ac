# SPDX-License-Identifier: Apache-2.0
"""Which pixels need more than their centre: neighbours on other surfaces, curvature, and visible edges of the CAD."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numba import njit

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from tof_core.arrays import Bytes, Float, Mask
    from tof_scene.topology import Edges

SHARP = np.cos(np.radians(20.0))
FLAT = np.cos(np.radians(0.1))
BEND, EDGE = np.uint8(1), np.uint8(2)
"""A pixel that sees one surface which is not flat there; one that may see two."""
NEAR_M = 1e-3
"""Nothing nearer to the camera along z is drawn."""
STEP_M = 1e-3
"""Neighbours further apart along z, seen from either plane, are on two surfaces."""
HIDDEN_M = 2e-4
PACE = 0.35
"""Pixels between the points at which an edge is looked at."""


def outline_edges(edges: Edges, normal: Float) -> tuple[NDArray[np.int32], NDArray[np.int32], Mask]:
    """Edges that can be seen: ends (e, 2), faces (e, 2), and whether an edge is one from every side (open or sharp).

    The others bound what is seen only where they separate a face toward the camera from one turned away.
    """
    second = np.maximum(edges.faces[:, 1], 0)
    cosine = np.einsum("ij,ij->i", normal[edges.faces[:, 0]], normal[second])
    always = (edges.faces[:, 1] < 0) | (cosine < SHARP)
    keep = always | (cosine < FLAT)
    return np.ascontiguousarray(edges.ends[keep]), np.ascontiguousarray(edges.faces[keep]), always[keep]


@njit(cache=True, nogil=True)
def mark_neighbours(
    flag: Bytes, depth: NDArray[np.float32], part: NDArray[np.int16], face: NDArray[np.int32], normal: NDArray[np.float32], rays: Float,
    tolerance: float,
) -> None:  # fmt: skip
    """Compare each pixel with its eight neighbours; all arrays (H, W, ...), flag is raised to BEND or EDGE.

    EDGE for both where the parts differ or depth steps. BEND where one's plane misses the other by `tolerance` metres, for the
    one on whose half of the way the two planes meet (a line that crosses a pixel passes its centre's side of the middle
    toward one of the eight).
    """
    rows, columns = depth.shape
    for i in range(rows):
        for j in range(columns):
            for k in range(4):  # right, below left, below, below right
                a, b = (i, j + 1) if k == 0 else (i + 1, j + k - 2)
                if a < rows and 0 <= b < columns and face[i, j] != face[a, b]:
                    _compare(flag, depth, part, normal, rays, tolerance, i, j, a, b)


@njit(cache=True, nogil=True, inline="always")
def _compare(
    flag: Bytes, depth: NDArray[np.float32], part: NDArray[np.int16], normal: NDArray[np.float32], rays: Float, tolerance: float,
    i: int, j: int, a: int, b: int,
) -> None:  # fmt: skip
    """Raise the flags of two neighbouring pixels."""
    here, there = _miss(depth, normal, rays, a, b, i, j), _miss(depth, normal, rays, i, j, a, b)
    if part[i, j] != part[a, b] or min(here, there) > STEP_M:
        flag[i, j] = flag[a, b] = EDGE
    elif max(here, there) > tolerance:
        at = here / (here + there) if here + there < np.inf else 0.5
        if at < 0.6:
            flag[i, j] = max(flag[i, j], BEND)
        if at > 0.4:
            flag[a, b] = max(flag[a, b], BEND)


@njit(cache=True, nogil=True, inline="always")
def _miss(depth: NDArray[np.float32], normal: NDArray[np.float32], rays: Float, i: int, j: int, a: int, b: int) -> float:
    """Distance along z between pixel (a, b)'s hit and pixel (i, j)'s plane."""
    here = there = 0.0
    for c in range(3):
        here += normal[i, j, c] * rays[i, j, c]
        there += normal[i, j, c] * rays[a, b, c]
    if there * here <= 0.0:
        return np.inf
    return abs(depth[i, j] * here / there - depth[a, b])


@njit(cache=True, nogil=True)
def mark_edges(
    flag: Bytes, ends: NDArray[np.int32], faces: NDArray[np.int32], always: Mask, points: Float, toward: Mask, raster: Float,
    pixel: NDArray[np.int32], depth: NDArray[np.float32], normal: NDArray[np.float32], rays: Float,
) -> None:  # fmt: skip
    """Raise to EDGE the pixels through which a visible outline passes, to BEND those with a sharp edge. Flat arrays over pixels; `points` (n, 3) in the camera frame.

    `toward` (m,) says which faces are turned to the camera. A point of an edge is hidden where it lies behind the plane seen
    at its pixel's centre: what is seen there ends at an edge in that plane, or at one before it.
    """
    for e in range(len(ends)):
        outline = faces[e, 1] < 0 or toward[faces[e, 0]] != toward[faces[e, 1]]
        if not (outline or always[e]):
            continue
        p, q = points[ends[e, 0]], points[ends[e, 1]]
        if p[2] < NEAR_M and q[2] < NEAR_M:
            continue
        if p[2] < NEAR_M or q[2] < NEAR_M:
            p, q = _clipped(p, q)
        _walk(flag, EDGE if outline else BEND, p, q, raster, pixel, depth, normal, rays)


@njit(cache=True, nogil=True)
def _clipped(p: Float, q: Float) -> tuple[Float, Float]:
    """The part of an edge in front of the camera."""
    s = (NEAR_M - p[2]) / (q[2] - p[2])
    cut = p + s * (q - p)
    return (cut, q) if p[2] < NEAR_M else (p, cut)


@njit(cache=True, nogil=True)
def _walk(
    flag: Bytes, level: np.uint8, p: Float, q: Float, raster: Float, pixel: NDArray[np.int32], depth: NDArray[np.float32], normal: NDArray[np.float32],
    rays: Float,
) -> None:  # fmt: skip
    """Look at an edge's points at an even pace in the image."""
    rows, columns = pixel.shape
    u0, v0 = (p[0] / p[2] - raster[0]) * raster[2], (p[1] / p[2] - raster[1]) * raster[3]
    du, dv = (q[0] / q[2] - raster[0]) * raster[2] - u0, (q[1] / q[2] - raster[1]) * raster[3] - v0
    low, high = _inside(u0, du, columns, 0.0, 1.0)
    low, high = _inside(v0, dv, rows, low, high)
    if low > high:
        return
    steps = int(max(abs(du), abs(dv)) * (high - low) / PACE) + 1
    for k in range(steps + 1):
        s = low + (high - low) * k / steps
        i, j = int(np.floor(v0 + s * dv)), int(np.floor(u0 + s * du))
        if i < 0 or j < 0 or i >= rows or j >= columns or pixel[i, j] < 0 or flag[pixel[i, j]] >= level:
            continue
        x, y = (u0 + s * du) / raster[2] + raster[0], (v0 + s * dv) / raster[3] + raster[1]
        z = 1.0 / ((1.0 - s) / p[2] + s / q[2])
        m = pixel[i, j]
        slant = normal[m, 0] * x + normal[m, 1] * y + normal[m, 2]
        here = normal[m, 0] * rays[m, 0] + normal[m, 1] * rays[m, 1] + normal[m, 2]
        seen = depth[m] * here / slant if slant * here > 0.0 else np.inf
        if not z > seen + HIDDEN_M:  # where nothing is seen the edge counts
            flag[pixel[i, j]] = level


@njit(cache=True, nogil=True, inline="always")
def _inside(start: float, step: float, size: int, low: float, high: float) -> tuple[float, float]:
    """The stretch of a line that lies within [0, size]."""
    if step == 0.0:
        return (low, high) if 0.0 <= start <= size else (1.0, 0.0)
    a, b = -start / step, (size - start) / step
    return max(low, min(a, b)), min(high, max(a, b))
