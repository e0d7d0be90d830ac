# SPDX-License-Identifier: Apache-2.0
"""Lens scattering: light of bright pixels reaches dark ones and shifts their depth."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from tof_core.config import param
from tof_sensor.action import ASIDE, FARTHER, NEARER
from tof_sensor.effect import Effect, Finer, Form
from tof_sensor.frame import LIGHT_M_PER_S, MODULATION

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from tof_core.arrays import Float, Ints
    from tof_sensor.frame import Frame
    from tof_sensor.session import Session

    ComplexImage = NDArray[np.complex128]


WIDTHS = (0.06, 0.2, 0.8)
"""Standard deviations of the three parts of stray light, as shares of the image's width: halo, middle, veil over the whole image."""


@dataclass(frozen=True, slots=True)
class LensScatter(Effect):
    """z' = z + s (h * z) on phasors A e^{j phi} (Schafer 2014; docs/effects.md).

    h is a sum of three Gaussians of unit sum (`WIDTHS`), which can represent narrow cores with long tails; each
    coefficient is the share of all light in that part. Frequency matters: light from a surface a quarter of a wavelength away shifts the
    phase most, from half a wavelength not at all.
    """

    NAME: ClassVar[str] = "lens_scatter"
    ORDER: ClassVar[int] = 40
    MEANING: ClassVar[str] = "light of bright surfaces spreads in the lens over dark ones"
    REMEDY: ClassVar[str] = "clean the lens and its window, and cover bright surfaces near the camera"
    SEPARATED_BY: ClassVar[str] = "the same view with the bright surface covered"
    ACTIONS: ClassVar = (ASIDE, NEARER, FARTHER)
    MODULATED: ClassVar[bool] = True
    FINER: ClassVar[tuple[Finer, ...]] = (Finer("modulation_mhz", 0.1),)
    LOCAL: ClassVar[bool] = False
    LINEAR: ClassVar[tuple[str, ...]] = ("halo", "middle", "veil")
    AT_EDGES: ClassVar[bool] = True

    halo: float = param(0.0, "share of the light that reaches nearby pixels", low=-0.1, high=0.5)
    middle: float = param(0.0, "share that is spread over a fifth of the image", low=-0.1, high=0.5)
    veil: float = param(0.0, "share that is spread over the whole image", low=-0.1, high=0.5)
    modulation_mhz: float = param(60.0, MODULATION, unit="MHz", low=5.0, high=400.0)

    def columns(self, frame: Frame) -> Float:
        """First order in the shares, along z: Im(stray / own) divided by the wave number."""
        every = self.columns_at(frame, np.arange(frame.depth.size))
        return every.reshape(*frame.depth.shape, -1)

    def columns_at(self, frame: Frame, pixels: Ints) -> Float:
        """`columns` at chosen pixels; the stray light is that of the whole image."""
        wave = 4e6 * np.pi * self.modulation_mhz / LIGHT_M_PER_S
        light = np.where(frame.valid, frame.amplitude, 0.0)
        turn = np.exp(1j * wave * np.nan_to_num(frame.radial))
        dark = np.maximum(light, 1e-3 * np.max(light, initial=1e-12)).ravel()[pixels]
        veils = [blurred(light * turn, width * frame.camera.width, pixels) for width in WIDTHS]
        own, length = turn.ravel()[pixels].conj(), frame.length.ravel()[pixels]
        seen = frame.valid.ravel()[pixels]
        return np.stack([np.where(seen, np.imag(v * own) / dark / wave / length, 0.0) for v in veils], axis=-1)

    @classmethod
    def lacks(cls, session: Session) -> str:
        """The amplitude image, if missing."""
        return "" if session.has_amplitude else "no amplitude image"

    @classmethod
    def hypotheses(cls, session: Session) -> Iterator[Form]:
        """One form per usual modulation frequency."""
        del session
        for mhz in (15.0, 30.0, 50.0, 65.0, 80.0, 90.0, 100.0, 110.0, 120.0):
            yield Form(cls(modulation_mhz=mhz), f"{mhz:g} MHz")


def blurred(own: ComplexImage, sigma: float, pixels: Ints) -> ComplexImage:
    """Gaussian filter of `sigma` pixels, at chosen pixels (n,); wide filters use block means."""
    from scipy.ndimage import gaussian_filter  # loads slowly, and the registry loads every effect

    block = max(1, int(sigma / 4))
    h, w = own.shape
    padded = np.pad(own, ((0, -h % block), (0, -w % block)))
    coarse = padded.reshape(padded.shape[0] // block, block, padded.shape[1] // block, block).mean(axis=(1, 3))
    parts = [gaussian_filter(part, sigma / block, mode="constant", truncate=3.0) for part in (coarse.real, coarse.imag)]
    down, across = _between(h, coarse.shape[0], block), _between(w, coarse.shape[1], block)
    real, imag = (down @ part @ across.T for part in parts)
    return np.asarray((real + 1j * imag).ravel()[pixels])


@lru_cache(maxsize=32)
def _between(size: int, blocks: int, block: int) -> Float:
    """(size, blocks) weights of linear interpolation between the centres of blocks; constant beyond the outer centres."""
    at = np.clip((np.arange(size) + 0.5) / block - 0.5, 0, blocks - 1)
    low = np.minimum(at.astype(int), max(blocks - 2, 0))
    weights = np.zeros((size, blocks))
    weights[np.arange(size), low] = 1.0 - (at - low)
    weights[np.arange(size), np.minimum(low + 1, blocks - 1)] += at - low
    return weights
