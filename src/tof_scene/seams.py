# SPDX-License-Identifier: Apache-2.0
"""Pixels that need fine sampling: those with neighbours on other surfaces, curvature, or visible edges of the CAD."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numba import njit

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from tof_core.arrays import Bytes, Float, Mask
    from tof_scene.topology import Edges

SHARP = np.cos(np.radians(20.0))
FLAT = np.cos(np.radians(0.1))
BEND, EDGE = np.uint8(1), np.uint8(2)
"""BEND: a pixel with one surface that is not flat. EDGE: a pixel that may have two surfaces."""
NEAR_M = 1e-3
"""Nearest z that is drawn, metres."""
STEP_M = 1e-3
"""Distance along z between the planes of neighbours, in metres, beyond which they are on two surfaces."""
HIDDEN_M = 2e-4


def outline_edges(edges: Edges, normal: Float) -> tuple[NDArray[np.int32], NDArray[np.int32], Mask]:
    """Edges that may be visible: ends (e, 2), faces (e, 2), and whether an edge is visible from every side (open or sharp).

    Other edges are outlines only between a face toward the camera and one turned away.
    """
    second = np.maximum(edges.faces[:, 1], 0)
    cosine = np.einsum("ij,ij->i", normal[edges.faces[:, 0]], normal[second])
    always = (edges.faces[:, 1] < 0) | (cosine < SHARP)
    keep = always | (cosine < FLAT)
    return np.ascontiguousarray(edges.ends[keep]), np.ascontiguousarray(edges.faces[keep]), always[keep]


def face_curvature(edges: Edges, vertices: Float, faces: NDArray[np.int32], normal: Float) -> NDArray[np.float32]:
    """(m,) 1/m: angle between neighbouring normals divided by the distance of the faces' centres across their edge; the largest of each face."""
    both = edges.faces[:, 1] >= 0
    (one, other), (p, q) = edges.faces[both].T, vertices[edges.ends[both]].transpose(1, 0, 2)
    cosine = np.einsum("ij,ij->i", normal[one], normal[other])
    middle = vertices[faces].mean(axis=1)
    along = (q - p) / np.maximum(np.linalg.norm(q - p, axis=1, keepdims=True), 1e-12)
    across = np.linalg.norm(np.cross(middle[other] - middle[one], along), axis=1)
    bend = np.where(cosine > SHARP, np.arccos(np.clip(cosine, -1, 1)) / np.maximum(across, 1e-6), 0.0)
    out = np.zeros(len(faces), np.float32)
    np.maximum.at(out, one, bend)
    np.maximum.at(out, other, bend)
    return out


@njit(cache=True, nogil=True)
def mark_curved(
    flag: Bytes, depth: NDArray[np.float32], face: NDArray[np.int32], incidence: NDArray[np.float32], curvature: NDArray[np.float32],
    pixel_angle: float, tolerance: float,
) -> None:  # fmt: skip
    """Raise to BEND the pixels whose mean depth curvature shifts by more than `tolerance` metres: footprint² x curvature / 24 (flat arrays)."""
    for i in range(len(flag)):
        if face[i] >= 0 and flag[i] < BEND:
            reach = depth[i] * pixel_angle / max(np.cos(incidence[i]), 0.05)
            if reach * reach * curvature[face[i]] > 24.0 * tolerance:
                flag[i] = BEND


@njit(cache=True, nogil=True)
def mark_neighbours(
    flag: Bytes, depth: NDArray[np.float32], part: NDArray[np.int16], face: NDArray[np.int32], normal: NDArray[np.float32], rays: Float,
    tolerance: float,
) -> None:  # fmt: skip
    """Compare each pixel with its eight neighbours once the outlines are marked; all arrays (H, W, ...), flag is raised to BEND or EDGE.

    Two pixels whose planes meet between them have a crease (or a line where parts intersect). The crease runs through the pixel on
    whose half they meet: a line through a pixel passes between its centre and that of at least one of the eight neighbours. Distances
    below `tolerance` metres within a part do not count. At a depth step an outline has usually marked one of the two pixels; if not,
    both are marked.
    """
    rows, columns = depth.shape
    for i in range(rows):
        for j in range(columns):
            for k in range(4):  # right, below left, below, below right
                a, b = (i, j + 1) if k == 0 else (i + 1, j + k - 2)
                if a < rows and 0 <= b < columns and face[i, j] != face[a, b] and not (flag[i, j] == EDGE and flag[a, b] == EDGE):
                    _compare(flag, depth, part, normal, rays, tolerance, i, j, a, b)


@njit(cache=True, nogil=True, inline="always")
def _compare(
    flag: Bytes, depth: NDArray[np.float32], part: NDArray[np.int16], normal: NDArray[np.float32], rays: Float, tolerance: float,
    i: int, j: int, a: int, b: int,
) -> None:  # fmt: skip
    """Raise the flags of two neighbouring pixels."""
    here, there = _miss(depth, normal, rays, a, b, i, j), -_miss(depth, normal, rays, i, j, a, b)
    near, far = min(abs(here), abs(there)), max(abs(here), abs(there))
    other = part[i, j] != part[a, b]
    if not near <= STEP_M and not here * there < 0.0:  # a step, or one of them sees nothing
        if flag[i, j] < EDGE and flag[a, b] < EDGE:
            flag[i, j] = flag[a, b] = EDGE
    elif other or far > tolerance:
        level = EDGE if other else BEND
        at = abs(here) / (abs(here) + abs(there)) if 0.0 < far < np.inf else 0.5
        bent = near > 2 * tolerance  # a miss so large both ways that either pixel may be curved
        if at < 0.6 or bent:
            flag[i, j] = max(flag[i, j], level if at < 0.6 else BEND)
        if at > 0.4 or bent:
            flag[a, b] = max(flag[a, b], level if at > 0.4 else BEND)


@njit(cache=True, nogil=True, inline="always")
def _miss(depth: NDArray[np.float32], normal: NDArray[np.float32], rays: Float, i: int, j: int, a: int, b: int) -> Any:
    """Distance along z of pixel (i, j)'s plane beyond pixel (a, b)'s hit."""
    here = there = 0.0
    for c in range(3):
        here += normal[i, j, c] * rays[i, j, c]
        there += normal[i, j, c] * rays[a, b, c]
    if there * here <= 0.0:
        return np.inf
    return depth[i, j] * here / there - depth[a, b]


@njit(cache=True, nogil=True)
def mark_edges(
    flag: Bytes, ends: NDArray[np.int32], faces: NDArray[np.int32], always: Mask, points: Float, toward: Mask, raster: Float,
    pixel: NDArray[np.int32], span: NDArray[np.int32], depth: NDArray[np.float32], normal: NDArray[np.float32], rays: Float,
) -> None:  # fmt: skip
    """Raise to EDGE the pixels through which a visible outline passes, to BEND those with a sharp edge. Flat arrays over pixels.

    `points` (n, 3) in the camera frame; `toward` (m,) marks faces turned to the camera; `raster`, `pixel` and `span` are of
    `Cells`. A point of an edge is hidden where it lies behind the plane seen at its pixel's centre: the visible surface ends
    at an edge in that plane, or at one in front of it.
    """
    cell_flag = np.zeros(pixel.shape, np.uint8)
    for e in range(len(ends)):
        outline = faces[e, 1] < 0 or toward[faces[e, 0]] != toward[faces[e, 1]]
        if not (outline or always[e]):
            continue
        p, q = points[ends[e, 0]], points[ends[e, 1]]
        if p[2] < NEAR_M and q[2] < NEAR_M:
            continue
        if p[2] < NEAR_M or q[2] < NEAR_M:
            p, q = _clipped(p, q)
        _walk(cell_flag, EDGE if outline else BEND, p, q, raster, pixel, depth, normal, rays)
    for i in range(len(span)):
        for r in range(span[i, 2], span[i, 3] + 1):
            for c in range(span[i, 0], span[i, 1] + 1):
                flag[i] = max(flag[i], cell_flag[r, c])


@njit(cache=True, nogil=True)
def _clipped(p: Float, q: Float) -> tuple[Float, Float]:
    """The part of an edge in front of the camera."""
    s = (NEAR_M - p[2]) / (q[2] - p[2])
    cut = p + s * (q - p)
    return (cut, q) if p[2] < NEAR_M else (p, cut)


@njit(cache=True, nogil=True)
def _walk(
    cell_flag: Bytes, level: np.uint8, p: Float, q: Float, raster: Float, pixel: NDArray[np.int32], depth: NDArray[np.float32],
    normal: NDArray[np.float32], rays: Float,
) -> None:  # fmt: skip
    """Visit the cells that an edge crosses, each in the middle of its section (Amanatides and Woo, A fast voxel traversal algorithm, 1987)."""
    rows, columns = pixel.shape
    u0, v0 = (p[0] / p[2] - raster[0]) * raster[2], (p[1] / p[2] - raster[1]) * raster[3]
    du, dv = (q[0] / q[2] - raster[0]) * raster[2] - u0, (q[1] / q[2] - raster[1]) * raster[3] - v0
    s, high = _inside(u0, du, columns, 0.0, 1.0)
    s, high = _inside(v0, dv, rows, s, high)
    while s < high:
        after = min(_next_line(u0, du, s), _next_line(v0, dv, s), high)
        middle = 0.5 * (s + after)
        i, j = int(np.floor(v0 + middle * dv)), int(np.floor(u0 + middle * du))
        s = after
        if i < 0 or j < 0 or i >= rows or j >= columns or pixel[i, j] < 0 or cell_flag[i, j] >= level:
            continue
        x, y = (u0 + middle * du) / raster[2] + raster[0], (v0 + middle * dv) / raster[3] + raster[1]
        z = 1.0 / ((1.0 - middle) / p[2] + middle / q[2])
        m = pixel[i, j]
        slant = normal[m, 0] * x + normal[m, 1] * y + normal[m, 2]
        here = normal[m, 0] * rays[m, 0] + normal[m, 1] * rays[m, 1] + normal[m, 2]
        seen = depth[m] * here / slant if slant * here > 0.0 else np.inf
        if not z > seen + HIDDEN_M:  # an edge before empty space counts
            cell_flag[i, j] = level


@njit(cache=True, nogil=True, inline="always")
def _next_line(start: float, step: float, s: float) -> Any:
    """Parameter along the edge at the next line of the raster, slightly beyond so that the walk continues."""
    if step == 0.0:
        return np.inf
    at = start + s * step
    line = np.floor(at + 1e-9) + 1.0 if step > 0 else np.ceil(at - 1e-9) - 1.0
    return (line - start) / step


@njit(cache=True, nogil=True, inline="always")
def _inside(start: float, step: float, size: int, low: float, high: float) -> tuple[float, float]:
    """The stretch of a line that lies within [0, size]."""
    if step == 0.0:
        return (low, high) if 0.0 <= start <= size else (1.0, 0.0)
    a, b = -start / step, (size - start) / step
    return max(low, min(a, b)), min(high, max(a, b))
