# SPDX-License-Identifier: Apache-2.0
"""A prepared reference: its surface, and the CAD around it where there is one."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from arm_correction.match import reference_surface, register_view
from arm_correction.surface import surface_of
from tof_scene.render import render

if TYPE_CHECKING:
    from arm_correction.config import CorrectConfig
    from arm_correction.reference import Reference
    from arm_correction.register import Registration
    from arm_correction.surface import Surface
    from tof_core.camera import Camera
    from tof_core.capture import View
    from tof_scene.raycast import Raycaster

TRUST_MM = 1.0
"""Standard deviation of the real surface from its CAD; the CAD only serves to come near."""


def wide_surface(caster: Raycaster, reference: Reference, config: CorrectConfig) -> Surface | None:
    """The CAD from the reference's pose, twice as wide and high; None without a pose by the CAD."""
    if reference.T_cell_camera is None:
        return None
    camera = widened(reference.camera)
    depth = render(caster, camera, reference.T_cell_camera, footprints=False).depth
    return surface_of(camera, depth, np.full(depth.shape, TRUST_MM * 1e-3), config.register)


def widened(camera: Camera) -> Camera:
    """The same camera with half an image more on each side, without distortion."""
    w, h = camera.width, camera.height
    return replace(camera, width=2 * w, height=2 * h, cx=camera.cx + w // 2, cy=camera.cy + h // 2, distortion=())


@dataclass(frozen=True, slots=True, eq=False)
class First:
    """A reference, its surface, and the CAD beyond its image border (None without CAD, or without a pose by CAD)."""

    reference: Reference
    surface: Surface
    wide: Surface | None

    @classmethod
    def of(cls, reference: Reference, config: CorrectConfig, caster: Raycaster | None = None) -> First:
        """Prepare a reference; once per reference."""
        return cls(reference, reference_surface(reference, config), wide_surface(caster, reference, config) if caster else None)

    def register(self, view: View, config: CorrectConfig) -> Registration:
        """Pose of the view's camera in the reference's camera frame; a view of another camera or size is refused."""
        self.reference.check(view)
        return register_view(self.reference, self.surface, view, config, self.wide)
