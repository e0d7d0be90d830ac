# SPDX-License-Identifier: Apache-2.0
"""Emitter offset: the lamp is beside the lens, so that light travels farther on one side of the image."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from tof_core.config import param
from tof_sensor.action import FARTHER, NEARER
from tof_sensor.effect import Effect, stack

if TYPE_CHECKING:
    from tof_core.arrays import Float
    from tof_sensor.frame import Frame

FARTHEST_M = 0.08
"""Largest distance of the lamp from the lens, metres: 5 to 8 cm in a Kinect v2, 1 to 4 cm in smaller cameras."""


@dataclass(frozen=True, slots=True)
class EmitterOffset(Effect):
    """dr = (|p - b| - |p|) / 2 = -b.u / 2 + (|b|^2 - (b.u)^2) / 4r + ..., u = p / |p| (law of cosines; docs/effects.md).

    b = (`x_m`, `y_m`, 0) is the lamp's position in the camera frame, x to the right and y down in the image: points on the lamp's side
    are measured too near. The columns are the first order, which is independent of range; `bias` is exact. The second order is 1.3 mm at
    0.5 m for a lamp 50 mm beside the lens. Shadows of such a lamp are not modelled.
    """

    NAME: ClassVar[str] = "emitter_offset"
    ORDER: ClassVar[int] = 31
    MEANING: ClassVar[str] = "the lamp stands beside the lens: one side of the image is measured too near, the other too far"
    REMEDY: ClassVar[str] = "state the lamp's place to the driver, or calibrate the camera's range at several distances"
    SEPARATED_BY: ClassVar[str] = "a flat wall seen from several distances"
    ACTIONS: ClassVar = (NEARER, FARTHER)
    MODULATED: ClassVar[bool] = True
    ONE_FORM: ClassVar[bool] = True
    LINEAR: ClassVar[tuple[str, ...]] = ("x_m", "y_m")

    x_m: float = param(0.0, "lamp to the right of the lens", unit="m", low=-FARTHEST_M, high=FARTHEST_M)

    y_m: float = param(0.0, "lamp below the lens", unit="m", low=-FARTHEST_M, high=FARTHEST_M)

    @property
    def stated(self) -> str:
        """Position of the lamp from where the driver takes it to be: its depth is right for a lamp there."""
        across, along = "right" if self.x_m >= 0.0 else "left", "below" if self.y_m >= 0.0 else "above"
        place = f"{1e3 * abs(self.x_m):.1f} mm to the {across} and {1e3 * abs(self.y_m):.1f} mm {along}"
        return (
            f"lamp {place}, in the image's directions, of where the driver takes it to be (at the lens, unless it knows the lamp's place)"
        )

    def columns(self, frame: Frame) -> Float:
        """First order along z: minus half of the direction's x and y."""
        scale = np.where(frame.valid, -0.5 / frame.length**2, 0.0)
        return stack([scale * frame.rays[..., 0], scale * frame.rays[..., 1]], frame)

    def bias(self, frame: Frame) -> Float:
        """Half of the difference between the paths from the lamp and to the lens, along z."""
        radial = frame.radial
        from_lamp = np.linalg.norm(frame.points - (self.x_m, self.y_m, 0.0), axis=-1)
        return np.asarray(np.nan_to_num(0.5 * (from_lamp - radial) / frame.length))
