# SPDX-License-Identifier: Apache-2.0
"""Radial depth: the camera gives distance along the ray where z is expected."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from tof_core.config import param
from tof_sensor.effect import Effect, stack

if TYPE_CHECKING:
    from tof_core.arrays import Float
    from tof_sensor.frame import Frame


@dataclass(frozen=True, slots=True)
class RadialDepth(Effect):
    """dz = share (r - z); a share of 1 is a camera that gives r (TOF_EFFECTS A.19)."""

    NAME: ClassVar[str] = "radial_depth"
    LINEAR: ClassVar[tuple[str, ...]] = ("share",)

    share: float = param(0.0, "1: radial given as z", low=-1.5, high=1.5)

    def columns(self, frame: Frame) -> Float:
        """Radial minus z."""
        return stack([frame.radial - frame.depth], frame)
