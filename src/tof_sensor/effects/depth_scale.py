# SPDX-License-Identifier: Apache-2.0
"""Depth scale: a wrong unit or modulation frequency stretches range."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from tof_core.config import param
from tof_sensor.effect import Effect, stack

if TYPE_CHECKING:
    from tof_core.arrays import Float
    from tof_sensor.frame import Frame


@dataclass(frozen=True, slots=True)
class DepthScale(Effect):
    """dz = s z (999 for 1000 units a metre makes s = 0.001; ROS_CONTRACT fact 2)."""

    NAME: ClassVar[str] = "depth_scale"
    LINEAR: ClassVar[tuple[str, ...]] = ("scale",)

    scale: float = param(0.0, "relative stretch", low=-0.2, high=0.2)

    def columns(self, frame: Frame) -> Float:
        """Depth itself."""
        return stack([frame.depth], frame)
