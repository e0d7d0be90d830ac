# SPDX-License-Identifier: Apache-2.0
"""Rendering of the scene from a camera pose: depth, part, normal, incidence, albedo, and the second surface of mixed pixels."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from tof_core import se3
from tof_core.cores import CORES, in_threads
from tof_scene.canvas import Canvas
from tof_scene.cells import cells_of
from tof_scene.overlaps import overlaps
from tof_scene.planes import points_to_camera, rays_to_cell
from tof_scene.rendering import Rendering
from tof_scene.resolve import LATTICES, lattice, resolve
from tof_scene.seams import mark_curved, mark_edges, mark_neighbours

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from tof_core.arrays import Bytes, Float
    from tof_core.camera import Camera
    from tof_scene.cells import Cells
    from tof_scene.raycast import Raycaster

__all__ = ["Rendering", "render", "thinned"]
TOLERANCE_M = 6e-5
"""Largest distance of neighbours from a pixel's plane without fine sampling; the error of the mean is at most a sixth of it."""
_lattices = tuple(lattice(*size) for size in LATTICES)


def fill_footprints(caster: Raycaster, camera: Camera, T_cell_camera: Float, cells: Cells, canvas: Canvas) -> NDArray[np.int64]:
    """Fill depth, face, mixed and second of the pixels with more than one plane; returns their flat indices."""
    points = points_to_camera(caster.vertices, T_cell_camera)
    flag = _flagged(caster, camera, T_cell_camera[:3, 3], points, cells, canvas)
    pixels = np.flatnonzero(flag)
    start, listed, rows = overlaps(points, caster.faces, cells, pixels)
    rays, turn, edge = cells.rays[pixels], cells.turn[pixels], flag[pixels]

    def work(begin: int, end: int) -> None:
        resolve(
            begin, end, pixels, edge, start, listed, rows, rays, turn, caster.face_part, _lattices,
            canvas.depth, canvas.face, canvas.mixed, canvas.second,
        )  # fmt: skip

    bounds = np.linspace(0, len(pixels), 4 * CORES + 1).astype(int)
    in_threads(work, bounds[:-1], bounds[1:])
    return pixels


def _flagged(caster: Raycaster, camera: Camera, eye: Float, points: Float, cells: Cells, canvas: Canvas) -> Bytes:
    """(H*W,) 0 for a pixel whose centre represents it, else BEND or EDGE."""
    flag = np.zeros(len(canvas.depth), np.uint8)
    shape = camera.shape
    toward = np.einsum("ij,ij->i", caster.face_normal, caster.face_point - eye) < 0
    mark_edges(flag, *caster.outline, points, toward, cells.raster, cells.pixel, cells.span, canvas.depth, canvas.normal, cells.rays)
    mark_curved(flag, canvas.depth, canvas.face, canvas.incidence, caster.curvature, camera.pixel_angle, TOLERANCE_M / 6)
    grids = (a.reshape(shape) for a in (flag, canvas.depth, canvas.part, canvas.face))
    mark_neighbours(*grids, canvas.normal.reshape(*shape, 3), cells.rays.reshape(*shape, 3), TOLERANCE_M)
    return flag


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
