# SPDX-License-Identifier: Apache-2.0
"""Hand-eye: the camera's pose in the hand differs from TF by the same motion in every view."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from tof_core import se3
from tof_core.config import param
from tof_sensor.action import ASIDE, FARTHER, NEARER
from tof_sensor.effect import Effect
from tof_sensor.geometry import pose_columns

if TYPE_CHECKING:
    from tof_core.arrays import Float
    from tof_sensor.frame import Frame


@dataclass(frozen=True, slots=True)
class HandEye(Effect):
    """X of the chain of poses (docs/effects.md): a right perturbation of the camera's pose."""

    NAME: ClassVar[str] = "hand_eye"
    ORDER: ClassVar[int] = 10
    MEANING: ClassVar[str] = "the camera sits in the hand otherwise than TF says"
    REMEDY: ClassVar[str] = "calibrate hand-eye again, and check that the mount is tight"
    SEPARATED_BY: ClassVar[str] = "a hand-eye calibration"
    ACTIONS: ClassVar = (ASIDE, NEARER, FARTHER)
    IN_CHAIN: ClassVar[bool] = True
    ONE_FORM: ClassVar[bool] = True
    LINEAR: ClassVar[tuple[str, ...]] = ("x_m", "y_m", "z_m", "rx_rad", "ry_rad", "rz_rad")

    x_m: float = param(0.0, "camera axis x", unit="m", low=-0.1, high=0.1)
    y_m: float = param(0.0, "camera axis y", unit="m", low=-0.1, high=0.1)
    z_m: float = param(0.0, "camera axis z", unit="m", low=-0.1, high=0.1)
    rx_rad: float = param(0.0, "about camera x", unit="rad", low=-0.2, high=0.2)
    ry_rad: float = param(0.0, "about camera y", unit="rad", low=-0.2, high=0.2)

    rz_rad: float = param(0.0, "about camera z", unit="rad", low=-0.2, high=0.2)

    @property
    def stated(self) -> str:
        """Translation and rotation."""
        shift, turn = self.coefficients[:3], self.coefficients[3:]
        return f"{1e3 * np.linalg.norm(shift):.1f} mm and {np.degrees(np.linalg.norm(turn)):.2f} degrees"

    def columns(self, frame: Frame) -> Float:
        """Change of z per unit of each component of the twist."""
        return pose_columns(frame)

    @property
    def mount(self) -> Float:
        """(4, 4) X of the chain."""
        return se3.exp(self.coefficients)
