# SPDX-License-Identifier: Apache-2.0
"""Lens scatter: a veil of light from bright pixels pulls dark ones toward their depth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from scipy.ndimage import gaussian_filter, map_coordinates

from tof_core.config import param
from tof_sensor.effect import Effect, stack
from tof_sensor.frame import LIGHT_M_PER_S

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from tof_core.arrays import Float
    from tof_sensor.frame import Frame

    ComplexImage = NDArray[np.complex128]


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
        veil = blurred(own, self.width * frame.camera.width)
        dark = np.maximum(light, 1e-3 * np.max(light, initial=1e-12))
        turn = np.imag(veil * np.exp(-1j * wave * np.nan_to_num(frame.radial))) / dark
        return stack([np.where(frame.valid, turn / wave, 0.0) / frame.length], frame)


def blurred(own: ComplexImage, sigma: float) -> ComplexImage:
    """Gaussian of `sigma` pixels; wide ones on block means, since the veil is smooth."""
    block = max(1, int(sigma / 5))
    h, w = own.shape
    padded = np.pad(own, ((0, -h % block), (0, -w % block)))
    coarse = padded.reshape(padded.shape[0] // block, block, padded.shape[1] // block, block).mean(axis=(1, 3))
    real, imag = (gaussian_filter(part, sigma / block, mode="constant", truncate=3.0) for part in (coarse.real, coarse.imag))
    if block == 1:
        return np.asarray(real + 1j * imag)
    at = np.meshgrid((np.arange(h) + 0.5) / block - 0.5, (np.arange(w) + 0.5) / block - 0.5, indexing="ij")
    fine = [map_coordinates(part, at, order=1, mode="nearest") for part in (real, imag)]
    return np.asarray(fine[0] + 1j * fine[1])
