# SPDX-License-Identifier: Apache-2.0
"""Time synchronisation: the image's stamp is late or early against the arm's."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from tof_core.config import param
from tof_sensor.effect import Effect
from tof_sensor.geometry import pose_columns

if TYPE_CHECKING:
    from tof_core.arrays import Float
    from tof_sensor.frame import Frame


@dataclass(frozen=True, slots=True)
class TimeSync(Effect):
    """The camera was where TF has it `delay_s` later: a pose error of twist times delay (A.15)."""

    NAME: ClassVar[str] = "time_sync"
    LINEAR: ClassVar[tuple[str, ...]] = ("delay_s",)

    delay_s: float = param(0.0, "true exposure minus stamp", unit="s", low=-1.0, high=1.0)

    def columns(self, frame: Frame) -> Float:
        """z by delay; 0 where the camera stood still."""
        return (pose_columns(frame) @ frame.context.twist)[..., None]
