# SPDX-License-Identifier: Apache-2.0
"""Emitter offset: the lamp stands beside the lens, so that light travels farther on one side of the image."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from tof_core.config import param
from tof_sensor.action import FARTHER, NEARER
from tof_sensor.effect import Effect, Form, stack

if TYPE_CHECKING:
    from collections.abc import Iterator

    from tof_core.arrays import Float
    from tof_sensor.frame import Frame
    from tof_sensor.session import Session

FARTHEST_M = 0.08
"""Farthest lamp: a Kinect v2 has its lamps 5 to 8 cm beside the lens, and smaller cameras theirs at 1 to 4 cm."""


@dataclass(frozen=True, slots=True)
class EmitterOffset(Effect):
    """dr = (|p - b| - |p|) / 2 = -b.u / 2 + (|b|^2 - (b.u)^2) / 4r + ..., u = p / |p| (law of cosines; docs/effects.md).

    b = (`x_m`, `y_m`, 0) is the lamp's place in the camera frame, x to the right and y down in the image: points on the lamp's side
    are measured too near. The columns are the first order, which no range changes; `bias` is exact. Of a lamp 50 mm beside the lens the
    second order is 1.3 mm at 0.5 m. Shadows that such a lamp casts are not modelled.
    """

    NAME: ClassVar[str] = "emitter_offset"
    ORDER: ClassVar[int] = 31
    MEANING: ClassVar[str] = "the lamp stands beside the lens: one side of the image is measured too near, the other too far"
    REMEDY: ClassVar[str] = "state the lamp's place to the driver, or calibrate the camera's range at several distances"
    SEPARATED_BY: ClassVar[str] = "a flat wall seen from several distances"
    ACTIONS: ClassVar = (NEARER, FARTHER)
    MODULATED: ClassVar[bool] = True
    LINEAR: ClassVar[tuple[str, ...]] = ("x_m", "y_m")

    x_m: float = param(0.0, "lamp to the right of the lens", unit="m", low=-FARTHEST_M, high=FARTHEST_M)

    y_m: float = param(0.0, "lamp below the lens", unit="m", low=-FARTHEST_M, high=FARTHEST_M)

    @property
    def stated(self) -> str:
        """The lamp beside the lens."""
        return f"lamp {1e3 * self.x_m:+.1f} mm to the right, {1e3 * self.y_m:+.1f} mm below"

    def columns(self, frame: Frame) -> Float:
        """First order: minus half the direction's x and y, along z."""
        scale = np.where(frame.valid, -0.5 / frame.length**2, 0.0)
        return stack([scale * frame.rays[..., 0], scale * frame.rays[..., 1]], frame)

    def bias(self, frame: Frame) -> Float:
        """Half of the difference between the path from the lamp and the path to the lens, along z."""
        radial = frame.radial
        from_lamp = np.linalg.norm(frame.points - (self.x_m, self.y_m, 0.0), axis=-1)
        return np.asarray(np.nan_to_num(0.5 * (from_lamp - radial) / frame.length))

    @classmethod
    def hypotheses(cls, session: Session) -> Iterator[Form]:
        """Its one form."""
        del session
        yield Form(cls())
