# SPDX-License-Identifier: Apache-2.0
"""Noise: scatter, as photons predict it (a law every sensor has) and beyond (an effect)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from tof_core.config import param
from tof_sensor.effect import Effect, Evidence

if TYPE_CHECKING:
    from tof_core.arrays import Float
    from tof_sensor.frame import Frame


@dataclass(frozen=True, slots=True)
class PhotonLaw(Effect):
    """sigma^2 = floor^2 + (shot^2 + far^2 r^2) A0 / A + ambient^2 (A0 / A)^2, along the ray r (TOF_EFFECTS A.5).

    Foreign light off a surface is the same from near and far while own light falls with r^2: at one amplitude A the farther
    surface is the brighter, hence `far_m`.
    """

    NAME: ClassVar[str] = "photon_law"
    EVIDENCE: ClassVar[Evidence] = Evidence.SCATTER

    floor_m: float = param(0.0003, "scatter that no light removes", unit="m", low=0.0, high=0.05)
    shot_m: float = param(0.001, "photon noise at the reference amplitude", unit="m", low=0.0, high=0.1)
    ambient_m: float = param(0.0, "ambient and read noise at the reference amplitude", unit="m", low=0.0, high=0.1)
    far_m: float = param(0.0, "noise of ambient light off the surface at the reference amplitude and 1 m", unit="m", low=0.0, high=0.1)
    reference: float = param(1.0, "reference amplitude in the camera's unit", low=1e-12)

    def apply(self, frame: Frame, rng: np.random.Generator) -> Frame:
        """Scatter by amplitude."""
        variance = self.variance(frame.amplitude, np.nan_to_num(frame.radial) ** 2)
        return scattered(frame, np.sqrt(variance) / frame.length, rng)

    def variance(self, amplitude: Float, range2: Float) -> Float:
        """m^2 along the ray at amplitudes and squared ranges (m^2)."""
        ratio = self.reference / np.maximum(amplitude, 1e-12)
        return np.asarray(self.floor_m**2 + (self.shot_m**2 + self.far_m**2 * range2) * ratio + (self.ambient_m * ratio) ** 2)


@dataclass(frozen=True, slots=True)
class Noise(Effect):
    """Scatter that the photon law does not predict: the same at every amplitude, or by a factor."""

    NAME: ClassVar[str] = "noise"
    EVIDENCE: ClassVar[Evidence] = Evidence.SCATTER

    extra_m: float = param(0.0, "scatter added at every amplitude", unit="m", low=0.0, high=0.1)
    factor: float = param(1.0, "the photon law's scatter times this", low=0.0, high=20.0)
    duty: float = param(1.0, "share of frames that have it", low=0.0, high=1.0)

    def apply(self, frame: Frame, rng: np.random.Generator) -> Frame:
        """Add what is missing to the scatter so far."""
        if self.duty < 1.0 and rng.random() >= self.duty:
            return frame
        grown = (max(self.factor, 1.0) ** 2 - 1) * frame.sigma**2
        return scattered(frame, np.sqrt(self.extra_m**2 + grown), rng)


def scattered(frame: Frame, sigma: np.ndarray[tuple[int, ...], np.dtype[np.float64]], rng: np.random.Generator) -> Frame:
    """The frame with normal scatter of `sigma` (H, W) metres of z added to depth and sigma."""
    depth = frame.depth + sigma * rng.standard_normal(frame.depth.shape)
    return replace(frame, depth=depth, sigma=np.hypot(frame.sigma, sigma))
