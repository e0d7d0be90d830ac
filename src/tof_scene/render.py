# SPDX-License-Identifier: Apache-2.0
"""Rendering of the scene from a camera pose: depth, part, normal, incidence, albedo, and the second surface of mixed pixels."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from tof_core import se3
from tof_scene.canvas import Canvas
from tof_scene.cells import cells_of
from tof_scene.footprint import fill_footprints
from tof_scene.planes import rays_to_cell
from tof_scene.rendering import Rendering

__all__ = ["Rendering", "render", "thinned"]

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from tof_core.camera import Camera
    from tof_scene.raycast import Raycaster


def render(caster: Raycaster, camera: Camera, T_cell_camera: ArrayLike, *, footprints: bool = True, step: int = 1) -> Rendering:
    """Render one view.

    Args:
        caster: the scene.
        camera: the raster; with `step` every step-th row and column of it.
        T_cell_camera: (4, 4) pose of the camera's optical frame in the cell.
        footprints: average over the area that each pixel covers; False takes the surface at the pixel's centre.
        step: stride of the raster; the result has the thinned camera. Pixels keep their footprint only
            without `footprints`, since a thinned raster has larger pixels.
    """
    T = se3.as_se3("camera pose", T_cell_camera)
    camera = thinned(camera, step) if step > 1 else camera
    cells = cells_of(camera)
    face, near = caster.first_faces(T[:3, 3], rays_to_cell(cells.rays, T[:3, :3]))
    canvas = Canvas.blank(camera.width * camera.height, face)
    every = np.arange(len(face))
    canvas.shade(caster, T, every, cells.rays, cells.turn if footprints else cells.turn[:0], near)
    if footprints:
        pixels = fill_footprints(caster, camera, T, cells, canvas)
        canvas.shade(caster, T, pixels, cells.rays, cells.turn, near)
    return canvas.rendering(camera, T)


def thinned(camera: Camera, step: int) -> Camera:
    """The camera of every step-th row and column, the first ones included."""
    return replace(
        camera, width=-(-camera.width // step), height=-(-camera.height // step),
        fx=camera.fx / step, fy=camera.fy / step, cx=camera.cx / step, cy=camera.cy / step,
    )  # fmt: skip
