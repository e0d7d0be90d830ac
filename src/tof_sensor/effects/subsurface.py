# SPDX-License-Identifier: Apache-2.0
"""Subsurface scattering: a translucent part returns light from below its surface."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from tof_core.config import param
from tof_sensor.effect import Effect, stack

if TYPE_CHECKING:
    from tof_core.arrays import Float
    from tof_sensor.frame import Frame


@dataclass(frozen=True, slots=True)
class Subsurface(Effect):
    """dr = delay / cos(refracted), constant over one material of index 1.5 (TOF_EFFECTS A.17)."""

    NAME: ClassVar[str] = "subsurface"
    LINEAR: ClassVar[tuple[str, ...]] = ("delay_m",)

    delay_m: float = param(0.0, "added along the ray at normal incidence", unit="m", low=0.0, high=0.1)
    part: int = param(0, "index of the part in the scene", low=0)

    def columns(self, frame: Frame) -> Float:
        """One over the cosine inside, on the pixels of the part."""
        sine = np.sin(np.nan_to_num(frame.rendering.incidence)) / 1.5
        inside = 1 / np.sqrt(1 - sine * sine)
        here = frame.rendering.part == self.part
        return stack([np.where(here, inside, 0.0) / frame.length], frame)
