# SPDX-License-Identifier: Apache-2.0
"""The photon law: temporal noise of the photons, which every sensor has."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from tof_core.config import param
from tof_sensor.average import averaged, before_average
from tof_sensor.effect import Effect, Evidence
from tof_sensor.frame import with_noise

if TYPE_CHECKING:
    from tof_core.arrays import Float, Mask
    from tof_sensor.frame import Frame


@dataclass(frozen=True, slots=True)
class PhotonLaw(Effect):
    """sigma^2 = floor^2 + (shot^2 + far^2 r^2 / cos theta) A0 / A + ambient^2 (A0 / A)^2, along the ray r, at incidence theta (docs/effects.md).

    Ambient light reflected by a surface is the same at every range and angle, while the lamp's light decreases with r^2 and with the
    cosine: at one amplitude A, farther and more oblique surfaces reflect more ambient light, hence `far_m`.

    That is the noise of a camera that averages over its whole `window_px`. Where neighbours differ by more than `within_m`, it leaves them out, and
    noise is higher (`tof_sensor.average`): up to that of a single pixel, `window_px` times as high.
    """

    NAME: ClassVar[str] = "photon_law"
    ORDER: ClassVar[int] = 70
    MEANING: ClassVar[str] = ""  # Every sensor has it: no effect.
    EVIDENCE: ClassVar[Evidence] = Evidence.NOISE

    floor_m: float = param(0.0003, "noise that does not decrease with light", unit="m", low=0.0, high=0.05)
    shot_m: float = param(0.001, "photon noise at the reference amplitude", unit="m", low=0.0, high=0.1)
    ambient_m: float = param(0.0, "ambient and read noise at the reference amplitude", unit="m", low=0.0, high=0.1)
    far_m: float = param(
        0.0, "noise of ambient light off the surface, at the reference amplitude, 1 m and head-on", unit="m", low=0.0, high=0.1
    )
    reference: float = param(1.0, "reference amplitude in the camera's unit", low=1e-12)
    window_px: int = param(1, "window over which the camera averages neighbours, which then share noise", unit="px", low=1, high=31)
    between: float = param(0.0, "variance between captures of a dwell over this law's; 0: not known", low=0.0, high=100.0)
    within_m: float = param(
        0.0,
        "difference from a pixel up to which neighbours in the window are averaged; 0: not known, or all are",
        unit="m",
        low=0.0,
        high=1.0,
    )
    darkest: float = param(0.0, "least amplitude that the law was measured at, in the camera's unit; 0: not known", low=0.0)

    def apply(self, frame: Frame, rng: np.random.Generator) -> Frame:
        """Add noise by amplitude."""
        variance = self.variance(frame.amplitude, frame.surroundings_m2)
        return with_noise(frame, np.sqrt(variance) / frame.length, rng, self.window_px)

    def holds(self, amplitude: Float) -> Mask:
        """(n,) whether the law was measured at amplitudes as low as these (n,)."""
        return np.asarray(amplitude >= self.darkest)

    def variance(self, amplitude: Float, surroundings2: Float) -> Float:
        """m^2 along the ray at amplitudes and squared ranges over the cosine of incidence (`Frame.surroundings_m2`)."""
        ratio = self.reference / np.maximum(amplitude, 1e-12)
        light = (self.shot_m**2 + self.far_m**2 * surroundings2) * ratio + (self.ambient_m * ratio) ** 2
        if self.within_m > 0.0:
            light = averaged(self.window_px**2 * light, self.window_px**2, self.within_m)
        return np.asarray(self.floor_m**2 + light)

    def of_whole(self, variance: Float) -> Float:
        """(n,) m^2: variance that the camera would have if it averaged over its whole window everywhere, from measured variances (n,).

        Those up to `floor_m` squared have no noise that an average changes.
        """
        if not self.within_m > 0.0:
            return variance
        light = np.maximum(variance - self.floor_m**2, 0.0)
        return np.asarray(
            np.minimum(variance, self.floor_m**2) + before_average(light, self.window_px**2, self.within_m) / self.window_px**2
        )

    @property
    def whole(self) -> PhotonLaw:
        """The law of the noise that `of_whole` states."""
        return replace(self, within_m=0.0)
