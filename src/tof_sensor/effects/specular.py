# SPDX-License-Identifier: Apache-2.0
"""Specular highlight: near the mirror direction the lobe biases and saturates."""

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
class Specular(Effect):
    """dr = b exp(-(incidence / lobe)^2): light and camera sit together, so the mirror direction is
    the normal's (TOF_EFFECTS A.11).
    """

    NAME: ClassVar[str] = "specular"
    LINEAR: ClassVar[tuple[str, ...]] = ("bias_m",)

    bias_m: float = param(0.0, "bias at the mirror direction", unit="m", low=-0.2, high=0.2)
    lobe_deg: float = param(8.0, "angle at which the lobe falls to 1/e", unit="deg", low=0.5, high=45.0)
    part: int = param(-1, "index of the shining part, -1: all", low=-1)

    def columns(self, frame: Frame) -> Float:
        """The lobe, along z."""
        lobe = np.exp(-((np.degrees(frame.rendering.incidence) / self.lobe_deg) ** 2))
        here = frame.valid & ((frame.rendering.part == self.part) | (self.part < 0))
        return stack([np.where(here, lobe, 0.0) / frame.length], frame)
