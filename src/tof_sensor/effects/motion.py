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
        along_ray = _taps(np.asarray(pixels, np.int64), seen.flow, seen.recedes, seen.moving, wave, self.tap_s, order)
        errors = along_ray / frame.length.ravel()[pixels, None]
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
    """Change of a view's pixels by the camera's motion.

    deepens (H, W): rate of the pixel's depth, m/s of z; flow (H, W, 2): along columns and rows, pixels/s; recedes: rate of a moving point's
    range, m/s; moving (H, W, 3): range in metres, amplitude, and the amplitude's rate per second.
    """

    deepens: Float
    flow: Float
    recedes: Float
    moving: Float


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
    moving = np.stack([frame.radial, light, light * np.nan_to_num(rate)], axis=-1)
    return Passing(deepens, np.stack(image_flow(frame), axis=-1), recedes, moving)


@njit(cache=True, nogil=True)
def _taps(pixels: Ints, flow: Float, recedes: Float, moving: Float, wave: float, tap_s: float, order: tuple[int, int, int, int]) -> Float:
    """(n, 3) metres along the ray: the taps' error at both constants of their phase, and the addition to the first by unmodulated light.

    flow (H, W, 2), recedes (H, W), moving (H, W, 3): see `Passing`. The taps' phase is that of the distance, or an eighth of a period
    beyond; unmodulated light equals modulated light. Taps 0 and 2 of an order measure a phasor's real part, 1 and 3 its imaginary part.
    """
    out = np.empty((len(pixels), 3))
    for i in range(len(pixels)):
        row, column = pixels[i] // recedes.shape[1], pixels[i] % recedes.shape[1]
        bare_re, bare_im, turned_re, turned_im, lit_re, lit_im = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for place in range(4):
            t, tap = (place - 1.5) * tap_s, order[place]
            range_m, light, grows = _at(moving, row - flow[row, column, 1] * t, column - flow[row, column, 0] * t)
            A, phase = light + grows * t, wave * (range_m + recedes[row, column] * t)
            cosine, sine, sign = A * np.cos(phase), A * np.sin(phase), 1.0 if tap < 2 else -1.0
            if tap % 2 == 0:
                bare_re += cosine
                turned_re += cosine - sine
                lit_re += sign * A
            else:
                bare_im += sine
                turned_im += cosine + sine
                lit_im += sign * A
        cosine, sine = np.cos(wave * moving[row, column, 0]), np.sin(wave * moving[row, column, 0])
        out[i, 0] = _turn(bare_re, bare_im, cosine, sine) / wave
        out[i, 1] = _turn(turned_re, turned_im, cosine - sine, cosine + sine) / wave
        out[i, 2] = _turn(bare_re + lit_re, bare_im + lit_im, cosine, sine) / wave - out[i, 0]
    return out


@njit(cache=True, nogil=True, inline="always")
def _turn(re: float, im: float, from_re: float, from_im: float) -> Any:
    """Radians from one phasor to another."""
    return np.arctan2(im * from_re - re * from_im, re * from_re + im * from_im)


@njit(cache=True, nogil=True, inline="always")
def _at(images: Float, v: float, u: float) -> Any:
    """Bilinear interpolation of three images (H, W, 3) at row `v`, column `u`; beyond the border, the border's values."""
    v, u = min(max(v, 0.0), images.shape[0] - 1.0), min(max(u, 0.0), images.shape[1] - 1.0)
    top, left = int(v), int(u)
    below, right = min(top + 1, images.shape[0] - 1), min(left + 1, images.shape[1] - 1)
    y, x = v - top, u - left
    a, b, c, d = (1 - y) * (1 - x), (1 - y) * x, y * (1 - x), y * x
    p, q, r, s = images[top, left], images[top, right], images[below, left], images[below, right]
    return a * p[0] + b * q[0] + c * r[0] + d * s[0], a * p[1] + b * q[1] + c * r[1] + d * s[1], a * p[2] + b * q[2] + c * r[2] + d * s[2]
