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
from tof_sensor.session import NO_AMPLITUDE
from tof_sensor.waves import sine_cosine

if TYPE_CHECKING:
    from collections.abc import Iterator

    from tof_core.arrays import Float, Ints
    from tof_sensor.frame import Frame
    from tof_sensor.session import Session


WIDTHS = (0.06, 0.2, 0.8)
"""Standard deviations of the three parts of stray light, as shares of the image's width: halo, middle, veil over the whole image."""
HARMONICS = 3
"""Sines that a window over range is made of: five describe the stray light of a coded camera no better."""
FREE = 2.2
"""Distance from the farthest surface to a window's next repetition, over its reach: a hundredth of the light there is taken in."""


@dataclass(frozen=True, slots=True)
class LensScatter(Effect):
    """z' = z + s (h * z) on phasors A e^{j phi} (Schafer 2014; docs/effects.md).

    h is a sum of three Gaussians of unit sum (`WIDTHS`), which can represent narrow cores with long tails; each
    coefficient is the share of all light in that part. Frequency matters: light from a surface a quarter of a wavelength away shifts the
    phase most, from half a wavelength not at all. A pulsed or coded camera takes in light of surfaces up to about `reach_m` nearer or
    farther: the bias is then the mean difference in range to the stray light, each part of it weighed by exp(-(difference / reach)^2).
    """

    NAME: ClassVar[str] = "lens_scatter"
    ORDER: ClassVar[int] = 40
    MEANING: ClassVar[str] = "light of bright surfaces spreads in the lens over dark ones"
    REMEDY: ClassVar[str] = "clean the lens and its window, and cover bright surfaces near the camera"
    SEPARATED_BY: ClassVar[str] = "the same view with the bright surface covered"
    ACTIONS: ClassVar = (ASIDE, NEARER, FARTHER)
    MODULATED: ClassVar[bool] = True
    FINER: ClassVar[tuple[Finer, ...]] = (Finer("modulation_mhz", 0.1), Finer("reach_m", 0.3))
    LOCAL: ClassVar[bool] = False
    LINEAR: ClassVar[tuple[str, ...]] = ("halo", "middle", "veil")
    AT_EDGES: ClassVar[bool] = True

    halo: float = param(0.0, "share of the light that reaches nearby pixels", low=-0.1, high=0.5)
    middle: float = param(0.0, "share that is spread over a fifth of the image", low=-0.1, high=0.5)
    veil: float = param(0.0, "share that is spread over the whole image", low=-0.1, high=0.5)
    modulation_mhz: float = param(60.0, MODULATION, unit="MHz", low=5.0, high=400.0)
    reach_m: float = param(
        0.0,
        "distance between surfaces within which a pulsed or coded camera takes in stray light; 0: modulated",
        unit="m",
        low=0.0,
        high=3.0,
    )

    def columns(self, frame: Frame) -> Float:
        """First order in the shares, along z: Im(stray / own) divided by the wave number, or a sum of such terms that makes the window."""
        every = self.columns_at(frame, np.arange(frame.depth.size))
        return every.reshape(*frame.depth.shape, -1)

    def columns_at(self, frame: Frame, pixels: Ints) -> Float:
        """`columns` at chosen pixels; the stray light is that of the whole image."""
        light = np.where(frame.valid, frame.amplitude, 0.0)
        dark = np.maximum(light, 1e-3 * np.max(light, initial=1e-12)).ravel()[pixels]
        along = np.where(frame.valid, frame.radial, 0.0)
        out = np.zeros((len(pixels), len(WIDTHS)))
        for size_m, waves in self._terms(along[frame.valid]):
            sine, cosine = sine_cosine(waves / (2.0 * np.pi) * along)
            sent, own_re, own_im = light * np.stack([cosine, sine]), cosine.ravel()[pixels], sine.ravel()[pixels]
            for column, width in zip(out.T, WIDTHS, strict=True):
                re, im = blurred(sent, width * frame.camera.width).reshape(2, -1)[:, pixels]
                column += size_m * (im * own_re - re * own_im)
        scale = np.where(frame.valid.ravel()[pixels], 1.0 / (dark * frame.length.ravel()[pixels]), 0.0)
        return out * scale[:, None]

    def _terms(self, ranges: Float) -> list[tuple[float, float]]:
        """Metres and radians per metre of the sines in the difference in range that make the bias by stray light of one pixel's amount.

        ranges: (n,) metres of the view's surfaces; a window repeats beyond their differences.
        """
        if self.reach_m == 0.0 or not len(ranges):
            waves = 4e6 * np.pi * self.modulation_mhz / LIGHT_M_PER_S
            return [(1.0 / waves, waves)]
        period = float(np.ptp(np.quantile(ranges, [0.005, 0.995]))) + FREE * self.reach_m
        x = np.linspace(-0.5 * period, 0.5 * period, 201)[:-1]
        window = x * np.exp(-((x / self.reach_m) ** 2))
        each = [2.0 * np.pi / period * n for n in range(1, HARMONICS + 1)]
        return [(float(2.0 * np.mean(window * np.sin(waves * x))), waves) for waves in each]

    @classmethod
    def lacks(cls, session: Session) -> str:
        """The amplitude image, if missing."""
        return "" if session.has_amplitude else NO_AMPLITUDE

    @classmethod
    def hypotheses(cls, session: Session) -> Iterator[Form]:
        """One form per stated modulation frequency; without any, one per usual frequency, and two of a pulse's or code's length."""
        for mhz in session.frequencies(15.0, 30.0, 50.0, 65.0, 80.0, 90.0, 100.0, 110.0, 120.0, 150.0, 190.0):
            yield Form(cls(modulation_mhz=mhz), f"{mhz:g} MHz")
        for reach in () if session.stated_mhz else (0.35, 0.9):
            yield Form(cls(reach_m=reach), f"pulse or code of {reach:g} m")


def blurred(images: Float, sigma: float) -> Float:
    """(k, H, W) Gaussian filter of `sigma` pixels; wide filters use block means, interpolated between the blocks' centres."""
    (down, up), (across, along) = (_filter(size, sigma) for size in images.shape[1:])
    return np.asarray(up @ (down @ images @ across.T) @ along.T)


@lru_cache(maxsize=32)
def _filter(size: int, sigma: float) -> tuple[Float, Float]:
    """The Gaussian filter of a line of `size` samples as (m, size), the filter of its m block means, and (size, m), their interpolation.

    The line is dark beyond its ends; the filter is cut off at three standard deviations.
    """
    block = max(1, int(sigma / 4))
    blocks, reach = -(-size // block), int(3.0 * sigma / block + 0.5)
    apart = np.abs(np.subtract.outer(np.arange(blocks), np.arange(blocks)))
    weights = np.exp(-0.5 * (np.arange(-reach, reach + 1) * block / sigma) ** 2)
    gauss = np.where(apart <= reach, np.exp(-0.5 * (apart * block / sigma) ** 2) / weights.sum(), 0.0)
    return gauss[:, np.arange(size) // block] / block, _interpolation(size, blocks, block)


def _interpolation(size: int, blocks: int, block: int) -> Float:
    """(size, blocks) weights of the two blocks between whose centres each sample lies; constant beyond the outer centres."""
    place = np.clip((np.arange(size) + 0.5) / block - 0.5, 0, blocks - 1)
    return np.maximum(1.0 - np.abs(np.subtract.outer(place, np.arange(blocks))), 0.0)
