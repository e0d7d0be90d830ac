# SPDX-License-Identifier: Apache-2.0
"""Planes of faces, and rays against them in float64."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numba import njit

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from tof_core.arrays import Float


def face_normals(vertices: Float, faces: NDArray[np.int32]) -> Float:
    """(m, 3) unit normals by the right-hand rule."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    n = np.cross(b - a, c - a)
    return np.asarray(n / np.linalg.norm(n, axis=1, keepdims=True))


@njit(cache=True, nogil=True, inline="always")
def plane_distance(height: float, along: float, rough: float) -> float:
    """Distance to a face's plane along a ray: `height` of the plane over the origin divided by `along`, both along the face's normal.

    `rough`, the library's float32 distance, is returned where the two differ by more than 1e-4: the normal of a thin triangle is
    inaccurate, and a ray within the plane has no single intersection.
    """
    exact = height / along if along != 0.0 else rough
    return exact if abs(exact - rough) <= 1e-4 * max(rough, 1e-3) else rough


@njit(cache=True, nogil=True)
def plane_hits(
    origins: Float, directions: Float, face: NDArray[np.int32], near: NDArray[np.float32], points: Float, normals: Float
) -> tuple[Float, Float]:
    """Distance (N,) and normal (N, 3) toward the origin, from the plane of the face each ray hit; NaN where face < 0.

    `near` (N,) is the library's distance, see `plane_distance`.
    """
    t = np.full(len(face), np.nan)
    out = np.full((len(face), 3), np.nan)
    for i in range(len(face)):
        f = face[i]
        if f < 0:
            continue
        along = height = 0.0
        for c in range(3):
            along += normals[f, c] * directions[i, c]
            height += normals[f, c] * (points[f, c] - origins[i, c])
        sign = -1.0 if along > 0 else 1.0
        for c in range(3):
            out[i, c] = sign * normals[f, c]
        t[i] = plane_distance(height, along, float(near[i]))
    return t, out


@njit(cache=True, nogil=True)
def rays_to_cell(rays: Float, R_cell_camera: Float) -> NDArray[np.float32]:
    """(n, 3) float32 directions turned into the cell (BLAS would start threads, which cost more than such a small product)."""
    R = R_cell_camera
    out = np.empty(rays.shape, np.float32)
    for i in range(len(rays)):
        for k in range(3):
            out[i, k] = R[k, 0] * rays[i, 0] + R[k, 1] * rays[i, 1] + R[k, 2] * rays[i, 2]
    return out


@njit(cache=True, nogil=True)
def points_to_camera(points: Float, T_cell_camera: Float) -> Float:
    """(n, 3) points of the cell in the camera frame."""
    T = T_cell_camera
    out = np.empty(points.shape)
    for i in range(len(points)):
        x, y, z = points[i, 0] - T[0, 3], points[i, 1] - T[1, 3], points[i, 2] - T[2, 3]
        for k in range(3):
            out[i, k] = T[0, k] * x + T[1, k] * y + T[2, k] * z
    return out


@njit(cache=True, nogil=True)
def ways_between(
    starts: Float, ends: Float, one: NDArray[np.int32], other: NDArray[np.int32], middle: Float
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """(k, 3), (k, 3) float32 origins, relative to `middle` (3,), and directions of the ways from points starts[one] to ends[other]."""
    origins, directions = np.empty((len(one), 3), np.float32), np.empty((len(one), 3), np.float32)
    for i in range(len(one)):
        for c in range(3):
            origins[i, c] = starts[one[i], c] - middle[c]
            directions[i, c] = ends[other[i], c] - starts[one[i], c]
    return origins, directions
