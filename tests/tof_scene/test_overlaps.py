# SPDX-License-Identifier: Apache-2.0
"""Triangles listed for the pixels that they touch."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np

from tests.tof_scene.solids import block, camera, looking, scene
from tof_scene.cells import cells_of
from tof_scene.overlaps import overlaps
from tof_scene.planes import points_to_camera
from tof_scene.raycast import Raycaster

FRONT = looking((1.0, 0.0, 0.0), (0.0, 0.0, 0.0))


def test_a_pixel_of_a_distorted_lens_lists_each_of_its_triangles_once() -> None:
    """It lies in up to four cells of the undistorted raster, and a triangle visits all of them."""
    bent = replace(camera(40, 30), distortion=(0.05, 0.0, 0.0, 0.0, 0.0))
    caster, cells = Raycaster(scene(box=block(0.0, 0.0, 0.0, (0.2, 0.4, 0.3)))), cells_of(bent)
    cells_of_pixel = (cells.span[:, 1] - cells.span[:, 0] + 1) * (cells.span[:, 3] - cells.span[:, 2] + 1)
    assert np.median(cells_of_pixel) == 4
    pixels = np.arange(bent.width * bent.height)
    start, listed, _ = overlaps(points_to_camera(caster.vertices, FRONT), caster.faces, cells, pixels)
    assert all(len(set(listed[a:b])) == b - a for a, b in itertools.pairwise(start))
    middle = 15 * 40 + 20
    assert start[middle + 1] - start[middle] >= 2, "the near and the far side of the box"
