# SPDX-License-Identifier: Apache-2.0
"""Noise: temporal noise that the photon law does not predict."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from tof_core.config import param
from tof_core.shares import in_percent
from tof_sensor.effect import Effect, Evidence
from tof_sensor.frame import with_noise
from tof_sensor.session import NO_AMPLITUDE
from tof_sensor.stated import KNOWN_SIZE

if TYPE_CHECKING:
    from tof_core.arrays import Float
    from tof_sensor.frame import Frame
    from tof_sensor.session import Session


OF_BURSTS = (
    "record those views again; if they stay noisy, look for what disturbs the camera there: a light, its supply, or what it sees, such as a "
    "surface that hardly returns light"
)
"""Remedy where some captures are noisier than the others."""


@dataclass(frozen=True, slots=True)
class Noise(Effect):
    """Noise beyond the photon law: constant over amplitude, or the law times a factor."""

    NAME: ClassVar[str] = "noise"
    ORDER: ClassVar[int] = 72
    MEANING: ClassVar[str] = "more noise than the amount of light explains"
    REMEDY: ClassVar[str] = "record longer dwells; where rows or single pixels are noisy, have the camera checked"
    SEPARATED_BY: ClassVar[str] = "bright and dark surfaces in longer dwells"
    EVIDENCE: ClassVar[Evidence] = Evidence.NOISE

    extra_m: float = param(0.0, "noise added at every amplitude", unit="m", low=0.0, high=0.1)
    factor: float = param(1.0, "the photon law's noise times this", low=0.0, high=20.0)
    duty: float = param(1.0, "share of frames that have it", low=0.0, high=1.0)

    @property
    def stated(self) -> str:
        """Its standard deviation, and in bursts the share of the captures."""
        some = f", in {in_percent(self.duty)} of the captures" if self.in_bursts else ""
        return f"{1e3 * self.extra_m:.1f} mm of noise beside the photon noise{some}"

    @property
    def remedy(self) -> str:
        """Longer dwells; in bursts, the disturbance of those captures."""
        return OF_BURSTS if self.in_bursts else self.REMEDY

    def apply(self, frame: Frame, rng: np.random.Generator) -> Frame:
        """Add the noise of the effect."""
        if self.duty < 1.0 and rng.random() >= self.duty:
            return frame
        grown = (max(self.factor, 1.0) ** 2 - 1) * frame.sigma**2
        return with_noise(frame, np.sqrt(self.extra_m**2 + grown), rng)

    @property
    def constant_variance(self) -> float:
        """Variance of the noise in every capture."""
        return self.extra_m**2 if self.duty == 1.0 else 0.0

    def noise(self, frame: Frame) -> Float:
        """(H, W) metres of z, beside the law times `factor`."""
        return np.asarray(np.sqrt(self.duty) * self.extra_m / frame.length)

    @property
    def in_bursts(self) -> bool:
        """Whether only some captures have the noise."""
        return self.duty < 1.0

    def includes(self, other: Effect) -> bool:
        """Whether the other noise is hardly larger, and in bursts as this one or in every capture as this one."""
        if not isinstance(other, Noise) or other.in_bursts != self.in_bursts:
            return False
        return other.extra_m <= KNOWN_SIZE * self.extra_m and other.factor <= KNOWN_SIZE * self.factor

    @classmethod
    def lacks(cls, session: Session) -> str:
        """The amplitude image, which the photon law needs, if missing."""
        return "" if session.has_amplitude else f"{NO_AMPLITUDE}; rows and single pixels alone can show it"
