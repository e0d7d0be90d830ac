# SPDX-License-Identifier: Apache-2.0
"""Wiggling: odd harmonics of the modulation alias in the taps and bend range periodically."""

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
class Wiggling(Effect):
    """dr = s sin(k phi) + c cos(k phi), phi = 4 pi f r / c0 (Lindner 2010; TOF_EFFECTS A.1).

    Four taps alias the 3rd and 5th harmonic into k = 4 (period c0 / 8 f), three taps into k = 3.
    """

    NAME: ClassVar[str] = "wiggling"
    LINEAR: ClassVar[tuple[str, ...]] = ("sine_m", "cosine_m")

    sine_m: float = param(0.0, "amplitude of sin(k phi)", unit="m", low=-0.1, high=0.1)
    cosine_m: float = param(0.0, "amplitude of cos(k phi)", unit="m", low=-0.1, high=0.1)
    modulation_mhz: float = param(100.0, "modulation frequency", unit="MHz", low=1.0, high=1000.0)
    harmonic: int = param(4, "aliased harmonic, = number of taps", low=1, high=16)

    @property
    def period_m(self) -> float:
        """Metres of range after which the error repeats."""
        return LIGHT_M_PER_S / (2e6 * self.modulation_mhz * self.harmonic)

    def columns(self, frame: Frame) -> Float:
        """Sine and cosine of the aliased phase, along z."""
        phase = 2 * np.pi * frame.radial / self.period_m
        length = frame.length
        return stack([np.sin(phase) / length, np.cos(phase) / length], frame)
