# SPDX-License-Identifier: Apache-2.0
"""Interference: a second emitter disturbs some of the frames."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from tof_core.config import param
from tof_core.shares import in_percent
from tof_sensor.effect import Effect, Evidence
from tof_sensor.frame import with_noise
from tof_sensor.stated import KNOWN_SIZE

if TYPE_CHECKING:
    from tof_core.arrays import Float
    from tof_sensor.frame import Frame


@dataclass(frozen=True, slots=True)
class Interference(Effect):
    """Noise in some of the frames (docs/effects.md), larger where the camera's light is weak."""

    NAME: ClassVar[str] = "interference"
    ORDER: ClassVar[int] = 74
    MEANING: ClassVar[str] = "another light source disturbs some of the captures"
    REMEDY: ClassVar[str] = (
        "look for another depth camera, laser scanner or flickering lamp in the cell and switch it off; let two depth cameras take turns, or set them to different channels"
    )
    SEPARATED_BY: ClassVar[str] = "the other light source switched off"
    MODULATED: ClassVar[bool] = True
    EVIDENCE: ClassVar[Evidence] = Evidence.NOISE

    burst_m: float = param(0.0, "noise in a hit frame at the reference amplitude", unit="m", low=0.0, high=0.2)
    duty: float = param(0.3, "share of frames that are hit", low=0.0, high=1.0)
    reference: float = param(1.0, "reference amplitude in the camera's unit", low=1e-12)

    @property
    def stated(self) -> str:
        """Size of the noise, and share of the captures."""
        return f"{1e3 * self.burst_m:.1f} mm in {in_percent(self.duty)} of the captures"

    def apply(self, frame: Frame, rng: np.random.Generator) -> Frame:
        """A disturbed frame gets a common offset, and noise of the same size."""
        if rng.random() >= self.duty:
            return frame
        size = self.burst_m * self.reference / np.maximum(frame.amplitude, 1e-12) / frame.length
        size = np.minimum(size, 20 * self.burst_m)
        beat = replace(frame, depth=frame.depth + size * np.sin(rng.uniform(0, 2 * np.pi)))
        return with_noise(beat, size, rng)

    def noise(self, frame: Frame) -> Float:
        """(H, W) metres of z."""
        size = self.burst_m * self.reference / np.maximum(frame.amplitude, 1e-12)
        return np.asarray(np.sqrt(self.duty) * size / frame.length)

    @property
    def in_bursts(self) -> bool:
        """Yes."""
        return True

    def includes(self, other: Effect) -> bool:
        """Whether the other disturbance is hardly larger."""
        return isinstance(other, Interference) and other.burst_m <= KNOWN_SIZE * self.burst_m
