# SPDX-License-Identifier: Apache-2.0
"""Time synchronisation: the image's stamp is late or early relative to the arm's."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from tof_core.config import param
from tof_sensor.effect import Effect
from tof_sensor.geometry import pose_columns

if TYPE_CHECKING:
    from tof_core.arrays import Float
    from tof_sensor.frame import Frame
    from tof_sensor.session import Session


@dataclass(frozen=True, slots=True)
class TimeSync(Effect):
    """The camera's pose is that of TF `delay_s` after the stamp: a pose error of twist times delay (docs/effects.md)."""

    NAME: ClassVar[str] = "time_sync"
    ORDER: ClassVar[int] = 12
    MEANING: ClassVar[str] = "image stamps and arm stamps disagree"
    REMEDY: ClassVar[str] = "synchronise the clocks of camera and robot, or record at rest"
    SEPARATED_BY: ClassVar[str] = "the same poses at twice the speed"
    ONE_FORM: ClassVar[bool] = True
    LINEAR: ClassVar[tuple[str, ...]] = ("delay_s",)

    delay_s: float = param(0.0, "true exposure minus stamp", unit="s", low=-1.0, high=1.0)

    @property
    def stated(self) -> str:
        """Delay and its sign."""
        side = "after" if self.delay_s > 0 else "before"
        return f"exposed {1e3 * abs(self.delay_s):.0f} ms {side} the stamp"

    def columns(self, frame: Frame) -> Float:
        """Change of z per second of delay; 0 for a camera at rest."""
        return (pose_columns(frame) @ frame.context.twist)[..., None]

    @property
    def late_s(self) -> float:
        """The delay."""
        return self.delay_s

    @classmethod
    def lacks(cls, session: Session) -> str:
        """A view in motion, if none is."""
        return "" if session.moving else "no view was taken in motion"
