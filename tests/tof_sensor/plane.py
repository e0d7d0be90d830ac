# SPDX-License-Identifier: Apache-2.0
"""A tilted plane rendered by hand: what the effects are tried on."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tof_core.camera import Camera
from tof_scene.render import Rendering
from tof_sensor.frame import Context, Frame, ideal_frame

if TYPE_CHECKING:
    from tof_core.arrays import Float

CAMERA = Camera(width=40, height=30, fx=38.0, fy=37.0, cx=19.3, cy=14.8)
NORMAL = np.array([0.3, -0.2, -1.0]) / np.linalg.norm([0.3, -0.2, -1.0])
OFFSET = -0.9
"""Points p of the plane obey NORMAL . p = OFFSET in the camera frame."""


def plane_depth(rays: Float, normal: Float = NORMAL, offset: float = OFFSET) -> Float:
    """z of the plane along rays (..., 3) with z = 1."""
    return np.asarray(offset / (rays @ normal))


def plane_frame(context: Context | None = None, amplitude: Float | None = None, part: int = 0) -> Frame:
    """The plane as a perfect sensor sees it."""
    rays = CAMERA.rays()
    shape = CAMERA.shape
    cosine = -(rays @ NORMAL) / CAMERA.ray_length()
    rendering = Rendering(
        camera=CAMERA,
        T_cell_camera=np.eye(4),
        depth=plane_depth(rays).astype(np.float32),
        part=np.full(shape, part, np.int16),
        face=np.zeros(shape, np.int32),
        normal=np.broadcast_to(NORMAL.astype(np.float32), (*shape, 3)).copy(),
        incidence=np.arccos(cosine).astype(np.float32),
        albedo=np.full(shape, 0.5, np.float32),
        mixed=np.zeros(shape, np.float32),
        second=np.full(shape, np.nan, np.float32),
    )
    return ideal_frame(rendering, context, amplitude)
