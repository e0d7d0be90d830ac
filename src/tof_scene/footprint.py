# SPDX-License-Identifier: Apache-2.0
"""Pixel footprints: pixels with more than one plane are sampled finely, and the samples counted per surface.

The paper renders the CAD finely and counts the samples that fall in each of the sensor's pixels (section 3.2). Here one ray
per pixel finds the surface at its centre. If the neighbours lie in the same plane and no visible edge of the CAD passes
through the pixel, the mean of that plane over the pixel has a closed form. In the other pixels the triangles that touch the pixel
are drawn at a lattice of points, nearest first, and counted per surface. No further ray is cast.
Objects with an outline in the CAD are found down to about a twentieth of a pixel (377 points, 1/19 of a pixel apart).
Thinner wires may fall between the points.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tof_core.cores import CORES, in_threads
from tof_scene.overlaps import overlaps
from tof_scene.planes import points_to_camera
from tof_scene.resolve import LATTICES, lattice, resolve
from tof_scene.seams import mark_curved, mark_edges, mark_neighbours

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from tof_core.arrays import Bytes, Float
    from tof_core.camera import Camera
    from tof_scene.canvas import Canvas
    from tof_scene.cells import Cells
    from tof_scene.raycast import Raycaster

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
