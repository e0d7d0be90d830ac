# SPDX-License-Identifier: Apache-2.0
"""Depth scale: a wrong unit or clock stretches range."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from tof_core.config import param
from tof_sensor.action import FARTHER, NEARER
from tof_sensor.effect import Effect, stack

if TYPE_CHECKING:
    from tof_core.arrays import Float
    from tof_sensor.frame import Frame


@dataclass(frozen=True, slots=True)
class DepthScale(Effect):
    """dz = s z (999 for 1000 units a metre makes s = 0.001)."""

    NAME: ClassVar[str] = "depth_scale"
    ORDER: ClassVar[int] = 82
    MEANING: ClassVar[str] = "all distances are stretched by one factor: the depth unit is wrong, or the camera's clock runs fast or slow"
    REMEDY: ClassVar[str] = (
        "check the depth unit and the mode that the driver states, then calibrate the camera's range at two distances or more"
    )
    STRAIGHT: ClassVar[bool] = True
    ACTIONS: ClassVar = (NEARER, FARTHER)
    EXACT: ClassVar[bool] = True
    ONE_FORM: ClassVar[bool] = True
    LINEAR: ClassVar[tuple[str, ...]] = ("scale",)

    scale: float = param(0.0, "relative stretch", low=-0.2, high=0.2)

    @property
    def stated(self) -> str:
        """The scale error in per cent."""
        return f"{100 * self.scale:+.2f} %"

    def columns(self, frame: Frame) -> Float:
        """Depth."""
        return stack([frame.depth], frame)
