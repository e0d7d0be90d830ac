# SPDX-License-Identifier: Apache-2.0
"""Flying pixels: a footprint over two surfaces adds their phasors and lies between or beside them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from tof_core.config import param
from tof_sensor.effect import Effect, stack
from tof_sensor.frame import LIGHT_M_PER_S

if TYPE_CHECKING:
    from tof_core.arrays import Float
    from tof_sensor.frame import Frame


@dataclass(frozen=True, slots=True)
class FlyingPixels(Effect):
    """(1 - m) A1 e^{j phi1} + m A2 e^{j phi2}, m the second surface's share (TOF_EFFECTS A.6).

    `share` blends from the surface that fills most (0) to the full mixture (1).
    """

    NAME: ClassVar[str] = "flying_pixels"
    LINEAR: ClassVar[tuple[str, ...]] = ("share",)

    share: float = param(0.0, "1: the footprint's phasors add in full", low=0.0, high=1.5)
    modulation_mhz: float = param(100.0, "modulation frequency", unit="MHz", low=5.0, high=400.0)

    def columns(self, frame: Frame) -> Float:
        """The mixture's depth minus the larger surface's, on mixed pixels."""
        length = frame.length
        wave = 4e6 * np.pi * self.modulation_mhz / LIGHT_M_PER_S
        m = np.nan_to_num(frame.rendering.mixed).astype(np.float64)
        near, second = frame.radial, frame.rendering.second.astype(np.float64) * length
        # Equal albedo and tilt: only the fall-off with range tells the two returns apart.
        ratio = m / np.maximum(1 - m, 1e-6) * (near / second) ** 2
        mixed = np.angle(1 + ratio * np.exp(1j * wave * (second - near))) / wave
        return stack([np.where(m > 0, mixed, 0.0) / length], frame)
