# SPDX-License-Identifier: Apache-2.0
"""The CAD as the first picture's camera would see it with a wider lens: what a start from far sees and the first picture did not."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from arm_correction.surface import surface_of
from tof_scene.render import render

if TYPE_CHECKING:
    from arm_correction.config import CorrectConfig
    from arm_correction.reference import Reference
    from arm_correction.surface import Surface
    from tof_core.camera import Camera
    from tof_scene.raycast import Raycaster

TRUST_MM = 1.0
"""How far what is built may be from its CAD; it only brings the hand near."""


def wide_surface(caster: Raycaster, reference: Reference, config: CorrectConfig) -> Surface | None:
    """The CAD from the first picture's pose, as wide and high again; None where that pose is not known by the CAD."""
    if reference.T_cell_camera is None:
        return None
    camera = widened(reference.camera)
    depth = render(caster, camera, reference.T_cell_camera, footprints=False).depth
    return surface_of(camera, depth, np.full(depth.shape, TRUST_MM * 1e-3), config.register)


def widened(camera: Camera) -> Camera:
    """The same pixels, half an image more on each side, no distortion."""
    w, h = camera.width, camera.height
    return replace(camera, width=2 * w, height=2 * h, cx=camera.cx + w // 2, cy=camera.cy + h // 2, distortion=())
