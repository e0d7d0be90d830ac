# SPDX-License-Identifier: Apache-2.0
"""Which pixels need more than their centre: neighbours on other surfaces, curvature, and visible edges of the CAD."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numba import njit

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from tof_core.arrays import Float, Mask
    from tof_scene.topology import Edges

SHARP = np.cos(np.radians(20.0))
FLAT = np.cos(np.radians(0.1))
NEAR_M = 1e-3
"""Nothing nearer to the camera along z is drawn."""
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
    flag: Mask, depth: NDArray[np.float32], part: NDArray[np.int16], face: NDArray[np.int32], normal: NDArray[np.float32], rays: Float,
    tolerance: float,
) -> None:  # fmt: skip
    """Flag both of two neighbouring pixels (of eight) whose parts differ, or where one's plane misses the other by `tolerance` metres."""
    rows, columns = depth.shape
    for i in range(rows):
        for j in range(columns):
            for k in range(4):
                a, b = i + (1 if k else 0), j + (1 if k < 2 else 2 - k if k == 2 else -1)
                if a >= rows or b < 0 or b >= columns or face[i, j] == face[a, b]:
                    continue
                if part[i, j] == part[a, b] and (flag[i, j] and flag[a, b]):
                    continue
                if (
                    part[i, j] != part[a, b]
                    or _miss(depth, normal, rays, i, j, a, b) > tolerance
                    or _miss(depth, normal, rays, a, b, i, j) > tolerance
                ):
                    flag[i, j] = flag[a, b] = True


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
    flag: Mask, ends: NDArray[np.int32], faces: NDArray[np.int32], always: Mask, points: Float, toward: Mask, raster: Float,
    pixel: NDArray[np.int32], depth: NDArray[np.float32], normal: NDArray[np.float32], rays: Float,
) -> None:  # fmt: skip
    """Flag the pixels through which a visible outline passes. Flat arrays over pixels; `points` (n, 3) in the camera frame.

    `toward` (m,) says which faces are turned to the camera. A point of an edge is hidden where it lies behind the plane seen
    at its pixel's centre by more than 1 mm and 0.2 %.
    """
    for e in range(len(ends)):
        if not always[e] and toward[faces[e, 0]] == toward[faces[e, 1]]:
            continue
        p, q = points[ends[e, 0]], points[ends[e, 1]]
        if p[2] < NEAR_M and q[2] < NEAR_M:
            continue
        if p[2] < NEAR_M or q[2] < NEAR_M:
            p, q = _clipped(p, q)
        _walk(flag, p, q, raster, pixel, depth, normal, rays)


@njit(cache=True, nogil=True)
def _clipped(p: Float, q: Float) -> tuple[Float, Float]:
    """The part of an edge in front of the camera."""
    s = (NEAR_M - p[2]) / (q[2] - p[2])
    cut = p + s * (q - p)
    return (cut, q) if p[2] < NEAR_M else (p, cut)


@njit(cache=True, nogil=True)
def _walk(
    flag: Mask, p: Float, q: Float, raster: Float, pixel: NDArray[np.int32], depth: NDArray[np.float32], normal: NDArray[np.float32],
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
        if i < 0 or j < 0 or i >= rows or j >= columns or pixel[i, j] < 0 or flag[pixel[i, j]]:
            continue
        x, y = (u0 + s * du) / raster[2] + raster[0], (v0 + s * dv) / raster[3] + raster[1]
        z = 1.0 / ((1.0 - s) / p[2] + s / q[2])
        n, at = normal[pixel[i, j]], rays[pixel[i, j]]
        slant = n[0] * x + n[1] * y + n[2]
        seen = depth[pixel[i, j]] * (n[0] * at[0] + n[1] * at[1] + n[2] * at[2]) / slant if slant != 0.0 else np.inf
        if not z > seen * 1.002 + 1e-3:  # where nothing is seen, `seen` is NaN and the edge counts
            flag[pixel[i, j]] = True


@njit(cache=True, nogil=True, inline="always")
def _inside(start: float, step: float, size: int, low: float, high: float) -> tuple[float, float]:
    """The stretch of a line that lies within [0, size]."""
    if step == 0.0:
        return (low, high) if 0.0 <= start <= size else (1.0, 0.0)
    a, b = -start / step, (size - start) / step
    return max(low, min(a, b)), min(high, max(a, b))
