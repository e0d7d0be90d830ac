# SPDX-License-Identifier: Apache-2.0
"""Range offset: one constant along every ray."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from tof_core.config import param
from tof_sensor.action import ASIDE
from tof_sensor.effect import Effect, stack

if TYPE_CHECKING:
    from tof_core.arrays import Float
    from tof_sensor.frame import Frame


@dataclass(frozen=True, slots=True)
class RangeOffset(Effect):
    """dr = constant. From one side of a part it cannot be separated from the pose."""

    NAME: ClassVar[str] = "range_offset"
    ORDER: ClassVar[int] = 60
    MEANING: ClassVar[str] = "one constant added to every range"
    REMEDY: ClassVar[str] = "calibrate the camera's range at a target of known distance"
    STRAIGHT: ClassVar[bool] = True
    ACTIONS: ClassVar = (ASIDE,)
    EXACT: ClassVar[bool] = True
    ONE_FORM: ClassVar[bool] = True
    LINEAR: ClassVar[tuple[str, ...]] = ("offset_m",)

    offset_m: float = param(0.0, "constant added along the ray", unit="m", low=-0.2, high=0.2)

    @property
    def stated(self) -> str:
        """The offset in millimetres."""
        return f"{1e3 * self.offset_m:+.1f} mm"

    def columns(self, frame: Frame) -> Float:
        """The constant along z: one over the ray's length."""
        return stack([frame.valid / frame.length], frame)
