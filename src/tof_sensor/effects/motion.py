# SPDX-License-Identifier: Apache-2.0
"""Motion: four taps are exposed one after another, each at another camera position."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numba import njit

from tof_core.config import param
from tof_sensor.effect import Effect, Finer, Form
from tof_sensor.frame import LIGHT_M_PER_S, MODULATION, once_per_frame
from tof_sensor.geometry import image_flow, pose_columns

if TYPE_CHECKING:
    from collections.abc import Iterator

    from tof_core.arrays import Float, Ints
    from tof_sensor.frame import Frame
    from tof_sensor.session import Session

IN_TURN, OPPOSITE_FIRST = (0, 1, 2, 3), (0, 2, 1, 3)
"""Phase shift of each tap in quarter periods, in order of time; it depends on the maker."""
EIGHTH = float(np.pi / 4)
"""Phase in radians that turns the sine of twice the phase into its cosine."""


@dataclass(frozen=True, slots=True)
class Motion(Effect):
    """Four taps `tap_s` apart around the mean time (Jimenez 2014; docs/effects.md).

    Depth is that of the mean time, late by `axial_s`. In addition, each tap measures the image shifted by its flow: tap k at time t collects
    A (c + cos(phi - k pi / 2)), with amplitude A and phase phi of the point in the pixel at that time, for a lamp that moves with the
    camera, and unmodulated light c. Where A or phi change along the flow, the four taps do not match, and their phase is wrong. The error
    is linear in c.

    The taps' phase is that of the distance plus a constant delay of the light relative to the gates, which the factory subtracts. The error
    depends on twice the taps' phase, so its sine and its cosine describe every such constant.
    """

    NAME: ClassVar[str] = "motion"
    ORDER: ClassVar[int] = 42
    MEANING: ClassVar[str] = "the hand moved while the frame was taken"
    REMEDY: ClassVar[str] = "record at rest, or move more slowly: the error grows with the speed"
    SEPARATED_BY: ClassVar[str] = "a capture at rest"
    MODULATED: ClassVar[bool] = True
    LOCAL: ClassVar[bool] = False
    LINEAR: ClassVar[tuple[str, ...]] = ("axial_s", "edge", "turned", "steady")
    OWN: ClassVar[tuple[str, ...]] = ("edge", "turned", "steady")
    ROUGH: ClassVar[float] = 0.1  # Surfaces that appear or vanish along the flow are not in the image of the mean time.
    SMEARS: ClassVar[bool] = True
    FINER: ClassVar[tuple[Finer, ...]] = (Finer("tap_s", 0.5), Finer("modulation_mhz", 0.2), Finer("tap_s", 0.15))
    AT_EDGES: ClassVar[bool] = True

    axial_s: float = param(0.0, "delay of the depth", unit="s", low=-0.5, high=0.5)
    edge: float = param(0.0, "error by the taps' differences, 1 if the taps' phase is that of the distance", low=-2.5, high=2.5)
    turned: float = param(0.0, "the same, 1 if the taps' phase is an eighth of a period beyond that of the distance", low=-2.5, high=2.5)
    steady: float = param(0.0, "ratio of unmodulated to modulated light", low=-5.0, high=10.0)
    tap_s: float = param(0.02, "time from one tap to the next", unit="s", low=1e-4, high=0.5)
    modulation_mhz: float = param(60.0, MODULATION, unit="MHz", low=5.0, high=400.0)
    opposite_first: bool = param(False, "the second tap is half a period from the first, not a quarter")

    def columns(self, frame: Frame) -> Float:
        """Rate of depth, and the taps' error at both phase constants and by unmodulated light; 0 for a camera at rest."""
        return self.columns_at(frame, np.arange(frame.depth.size)).reshape(*frame.depth.shape, len(self.LINEAR))

    def columns_at(self, frame: Frame, pixels: Ints) -> Float:
        """(n, 4) rows of `columns` at chosen pixels."""
        if not frame.context.twist.any():
            return np.zeros((len(pixels), len(self.LINEAR)))
        seen, wave = _passing(frame), 4e6 * np.pi * self.modulation_mhz / LIGHT_M_PER_S
        order = OPPOSITE_FIRST if self.opposite_first else IN_TURN
        errors = _taps(np.asarray(pixels, np.int64), *seen.images, wave, self.tap_s, order) / frame.length.ravel()[pixels, None]
        return np.asarray(np.nan_to_num(np.concatenate([seen.deepens.ravel()[pixels, None], errors], axis=1)))

    @property
    def late_s(self) -> float:
        """Delay of the mean time."""
        return self.axial_s

    @property
    def apart_s(self) -> float:
        """Seconds from one tap to the next, estimated from the size of the taps' error; `tap_s` is only a value of the form."""
        return float(np.hypot(self.edge, self.turned) * self.tap_s)

    @classmethod
    def lacks(cls, session: Session) -> str:
        """A view in motion, if none is."""
        return "" if session.moving else "no view was taken in motion"

    @classmethod
    def hypotheses(cls, session: Session) -> Iterator[Form]:
        """Stated or usual frequencies, usual times between taps and orders of the taps."""
        for mhz, tap, opposite in itertools.product(
            session.frequencies(60.0, 80.0, 100.0), (0.005, 0.01, 0.02, 0.035, 0.06), (False, True)
        ):
            order = "opposite first" if opposite else "in turn"
            yield Form(cls(modulation_mhz=mhz, tap_s=tap, opposite_first=opposite), f"{mhz:g} MHz, {1e3 * tap:g} ms, {order}")


@dataclass(frozen=True, slots=True, eq=False)
class Passing:
    """Change of a view's pixels by the camera's motion, each (H, W).

    deepens: rate of the pixel's depth, m/s of z; images: flow along columns and rows, pixels/s; range in metres and its rate at a moving
    point, m/s; amplitude and its rate, per second.
    """

    deepens: Float
    images: tuple[Float, Float, Float, Float, Float, Float]


@partial(once_per_frame, whole=True)
def _passing(frame: Frame) -> Passing:
    """The changes of a view's pixels under the camera's twist, which do not depend on the effect's shape.

    The measured amplitude is used, so that textures count that the scene lacks. Its rate is that of Lambert's n.p / r^3, with the point p
    and its normal n in the camera's frame, where both rotate alike and the lamp is fixed.
    """
    v, point, normal = frame.context.twist[:3], np.nan_to_num(frame.points), np.nan_to_num(frame.rendering.normal)
    radial = np.maximum(frame.radial, 1e-6)
    recedes = -(point @ v) / radial
    facing = np.einsum("hwi,hwi->hw", normal, point)
    rate = np.divide(-(normal @ v), facing, out=np.zeros_like(facing), where=facing < 0) - 3 * recedes / radial
    light = np.nan_to_num(frame.amplitude)
    deepens = pose_columns(frame) @ frame.context.twist
    return Passing(deepens, (*image_flow(frame), frame.radial, recedes, light, light * np.nan_to_num(rate)))


@njit(cache=True, nogil=True)
def _taps(
    pixels: Ints,
    along_u: Float,
    along_v: Float,
    radial: Float,
    recedes: Float,
    light: Float,
    grows: Float,
    wave: float,
    tap_s: float,
    order: tuple[int, int, int, int],
) -> Float:
    """(n, 3) metres along the ray: the taps' error at both constants of their phase, and the addition to the first by unmodulated light.

    The taps' phase is that of the distance, or `EIGHTH` beyond; unmodulated light equals modulated light.
    """
    out = np.empty((len(pixels), 3))
    for i in range(len(pixels)):
        row, column = pixels[i] // light.shape[1], pixels[i] % light.shape[1]
        bare, turned, lit = 0j, 0j, 0j
        for place in range(4):
            t, turn = (place - 1.5) * tap_s, order[place] * np.pi / 2
            v, u = row - along_v[row, column] * t, column - along_u[row, column] * t
            A = _at(light, v, u) + _at(grows, v, u) * t
            phase = wave * (_at(radial, v, u) + recedes[row, column] * t) - turn
            cosine, sine = A * np.cos(phase), A * np.sin(phase)
            quarter = complex(np.cos(turn), np.sin(turn))
            bare += quarter * cosine
            turned += quarter * (cosine * np.cos(EIGHTH) - sine * np.sin(EIGHTH))
            lit += quarter * (A + cosine)
        own = wave * radial[row, column]
        back = complex(np.cos(own), -np.sin(own))
        out[i, 0] = np.angle(bare * back) / wave
        out[i, 1] = np.angle(turned * back * complex(np.cos(EIGHTH), -np.sin(EIGHTH))) / wave
        out[i, 2] = np.angle(lit * back) / wave - out[i, 0]
    return out


@njit(cache=True, nogil=True, inline="always")
def _at(image: Float, v: float, u: float) -> Any:
    """Bilinear interpolation at row `v`, column `u`; beyond the border, the border's value."""
    v, u = min(max(v, 0.0), image.shape[0] - 1.0), min(max(u, 0.0), image.shape[1] - 1.0)
    top, left = int(v), int(u)
    below, right = min(top + 1, image.shape[0] - 1), min(left + 1, image.shape[1] - 1)
    y, x = v - top, u - left
    upper = (1 - x) * image[top, left] + x * image[top, right]
    lower = (1 - x) * image[below, left] + x * image[below, right]
    return (1 - y) * upper + y * lower
