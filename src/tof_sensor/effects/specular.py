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
    """dr = b S / (S + M): the coat's lobe S and the matt light M = albedo cos(incidence) share the pixel.

    S = gloss exp(-(tan(incidence) / tan(lobe))^2) (Beckmann): light and camera sit together, so the
    mirror direction is the normal's (TOF_EFFECTS A.11).
    """

    NAME: ClassVar[str] = "specular"
    LINEAR: ClassVar[tuple[str, ...]] = ("bias_m",)

    bias_m: float = param(0.0, "bias of the coat's own light", unit="m", low=-0.2, high=0.2)
    lobe_deg: float = param(12.0, "angle at which the lobe falls to 1/e", unit="deg", low=0.5, high=60.0)
    gloss: float = param(0.5, "the lobe's peak, as an albedo", low=1e-3, high=100.0)
    part: int = param(-1, "index of the shining part, -1: all", low=-1)

    def columns(self, frame: Frame) -> Float:
        """The coat's share of the light, along z."""
        incidence = np.minimum(np.nan_to_num(frame.rendering.incidence.astype(np.float64), nan=1.5), 1.5)
        coat = self.gloss * np.exp(-((np.tan(incidence) / np.tan(np.radians(self.lobe_deg))) ** 2))
        matt = np.maximum(np.nan_to_num(frame.rendering.albedo.astype(np.float64)) * np.cos(incidence), 1e-6)
        here = frame.valid & ((frame.rendering.part == self.part) | (self.part < 0))
        return stack([np.where(here, coat / (coat + matt), 0.0) / frame.length], frame)
