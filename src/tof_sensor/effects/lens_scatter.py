# SPDX-License-Identifier: Apache-2.0
"""Lens scatter: a veil of light from bright pixels pulls dark ones toward their depth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from scipy.ndimage import gaussian_filter

from tof_core.config import param
from tof_sensor.effect import Effect, stack
from tof_sensor.frame import LIGHT_M_PER_S

if TYPE_CHECKING:
    from tof_core.arrays import Float
    from tof_sensor.frame import Frame


@dataclass(frozen=True, slots=True)
class LensScatter(Effect):
    """z' = z + s (h * z) on phasors A e^{j phi} (Schafer 2014; TOF_EFFECTS A.8).

    h is a Gaussian of unit sum, `width` of the image wide; s is the veil's share of all light.
    """

    NAME: ClassVar[str] = "lens_scatter"
    LOCAL: ClassVar[bool] = False
    LINEAR: ClassVar[tuple[str, ...]] = ("share",)

    share: float = param(0.0, "share of the light that is scattered", low=0.0, high=0.5)
    width: float = param(0.3, "standard deviation of the veil over the image's width", low=0.01, high=10.0)
    modulation_mhz: float = param(60.0, "modulation frequency (weak influence)", unit="MHz", low=5.0, high=400.0)

    def columns(self, frame: Frame) -> Float:
        """First order in the share: Im(veil / own) over the wave number."""
        wave = 4e6 * np.pi * self.modulation_mhz / LIGHT_M_PER_S
        light = np.where(frame.valid, frame.amplitude, 0.0)
        own = light * np.exp(1j * wave * np.nan_to_num(frame.radial))
        sigma = self.width * frame.camera.width
        veil = gaussian_filter(own.real, sigma, mode="constant") + 1j * gaussian_filter(own.imag, sigma, mode="constant")
        dark = np.maximum(light, 1e-3 * np.max(light, initial=1e-12))
        turn = np.imag(veil * np.exp(-1j * wave * np.nan_to_num(frame.radial))) / dark
        return stack([np.where(frame.valid, turn / wave, 0.0) / frame.length], frame)
