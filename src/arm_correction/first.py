# SPDX-License-Identifier: Apache-2.0
"""A prepared reference: its surface, and the CAD around it where there is one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from arm_correction.match import reference_surface, register_view
from arm_correction.wide import wide_surface

if TYPE_CHECKING:
    from arm_correction.config import CorrectConfig
    from arm_correction.reference import Reference
    from arm_correction.register import Registration
    from arm_correction.surface import Surface
    from tof_core.capture import View
    from tof_scene.raycast import Raycaster


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
