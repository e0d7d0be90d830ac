# SPDX-License-Identifier: Apache-2.0
"""Depth, normal, incidence and albedo of a pixel from its face; computed in float64, stored in float32."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numba import njit

from tof_scene.planes import plane_distance

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from tof_core.arrays import Float, Image

STEEP = 0.1
"""Largest square of the relative change of 1/z over a pixel for which the mean is expanded; beyond, the plane is nearly parallel to the ray."""


@njit(cache=True, nogil=True)
def shade(
    pixels: NDArray[np.int64], rays: Float, turn: Float, face: NDArray[np.int32], near: NDArray[np.float32], point: Float, normal: Float,
    face_part: NDArray[np.int16], albedo: NDArray[np.float32], T_cell_camera: Float, depth: Image, part: NDArray[np.int16],
    out_normal: NDArray[np.float32], incidence: Image, out_albedo: Image,
) -> None:  # fmt: skip
    """Fill the five outputs (flat over pixels) of `pixels` from their faces; pixels without a face get NaN and -1.

    Where `depth` is NaN it is computed: the plane at the pixel's centre, averaged over the pixel when `turn` (pixels, 4) is
    not empty: mean of 1/(a + b u + c v) over the unit square is (1 + (b² + c²) / 12 a²) / a to second order.
    """
    R, eye = T_cell_camera[:3, :3], T_cell_camera[:3, 3]
    for i in pixels:
        f = face[i]
        if f < 0:
            part[i], incidence[i], out_albedo[i], depth[i] = -1, np.nan, np.nan, np.nan
            out_normal[i, :] = np.nan
            continue
        nx = R[0, 0] * normal[f, 0] + R[1, 0] * normal[f, 1] + R[2, 0] * normal[f, 2]
        ny = R[0, 1] * normal[f, 0] + R[1, 1] * normal[f, 1] + R[2, 1] * normal[f, 2]
        nz = R[0, 2] * normal[f, 0] + R[1, 2] * normal[f, 1] + R[2, 2] * normal[f, 2]
        x, y, z = rays[i, 0], rays[i, 1], rays[i, 2]
        along = nx * x + ny * y + nz * z
        if np.isnan(depth[i]):
            height = normal[f, 0] * (point[f, 0] - eye[0]) + normal[f, 1] * (point[f, 1] - eye[1]) + normal[f, 2] * (point[f, 2] - eye[2])
            depth[i] = plane_distance(height, along, float(near[i])) * (_spread(nx, ny, along, turn[i]) if len(turn) else 1.0)
        sign = -1.0 if along > 0 else 1.0
        out_normal[i, 0], out_normal[i, 1], out_normal[i, 2] = sign * nx, sign * ny, sign * nz
        incidence[i] = math.acos(min(abs(along) / math.sqrt(x * x + y * y + z * z), 1.0))
        part[i] = face_part[f]
        out_albedo[i] = albedo[face_part[f]]


@njit(cache=True, nogil=True, inline="always")
def _spread(nx: float, ny: float, along: float, turn: Float) -> float:
    """Mean z over a pixel, relative to z at its centre."""
    b, c = (nx * turn[0] + ny * turn[1]) / along, (nx * turn[2] + ny * turn[3]) / along
    s = b * b + c * c
    return 1.0 + s / 12.0 if s < STEEP else 1.0
