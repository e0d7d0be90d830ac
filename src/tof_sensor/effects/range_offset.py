# SPDX-License-Identifier: Apache-2.0
"""Range offset: one constant along every ray."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from tof_core.config import param
from tof_sensor.effect import Effect, stack

if TYPE_CHECKING:
    from tof_core.arrays import Float
    from tof_sensor.frame import Frame


@dataclass(frozen=True, slots=True)
class RangeOffset(Effect):
    """dr = constant. From one side of a part it cannot be told from the pose (DESIGN section 5)."""

    NAME: ClassVar[str] = "range_offset"
    LINEAR: ClassVar[tuple[str, ...]] = ("offset_m",)

    offset_m: float = param(0.0, "constant added along the ray", unit="m", low=-0.2, high=0.2)

    def columns(self, frame: Frame) -> Float:
        """One over the ray's length: the constant, along z."""
        return stack([frame.valid / frame.length], frame)
