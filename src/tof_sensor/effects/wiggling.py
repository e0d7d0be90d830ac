# SPDX-License-Identifier: Apache-2.0
"""Wiggling: odd harmonics of the modulation alias in the taps and cause a periodic range error."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from tof_core.config import param
from tof_sensor.action import FARTHER, NEARER
from tof_sensor.curve import CurveEffect
from tof_sensor.effect import Finer, Form, stack
from tof_sensor.frame import LIGHT_M_PER_S
from tof_sensor.waves import sine_cosine

if TYPE_CHECKING:
    from collections.abc import Iterator

    from tof_core.arrays import Float
    from tof_sensor.frame import Frame
    from tof_sensor.session import Session


@dataclass(frozen=True, slots=True)
class Wiggling(CurveEffect):
    """dr = s sin(k phi) + c cos(k phi), phi = 4 pi f (r + a u + d v) / c0 (Lindner 2010; docs/effects.md).

    Four taps alias the 3rd and 5th harmonic into k = 4 (period c0 / 8 f), three taps into k = 3. The wave follows the phase measured by a
    pixel, which increases over the columns (u, share of the image's width) and rows (v) by the skew of the demodulation clock and by the
    lamp's position. The factory corrects both in the range, but not in the wave. With `knots`, dr is any function of r with mean 0, such
    as the error of a calibration table measured on another camera; its mean would be an offset, which is another effect.
    """

    NAME: ClassVar[str] = "wiggling"
    ORDER: ClassVar[int] = 50
    MEANING: ClassVar[str] = "the range error swings with distance, because of the shape of the emitted wave or pulse"
    REMEDY: ClassVar[str] = "renew the camera's range calibration over its whole range, or simulate with sensor.yaml"
    SEPARATED_BY: ClassVar[str] = "views over the camera's whole range"
    ACTIONS: ClassVar = (NEARER, FARTHER)
    MODULATED: ClassVar[bool] = True
    REPEATS: ClassVar[bool] = True  # Each frequency of a camera with two or three, and each harmonic, has its own wave.
    FINER: ClassVar[tuple[Finer, ...]] = (
        *(Finer("modulation_mhz", width, 13) for width in (0.2, 0.05, 0.012)),
        Finer("across_m", 0.06, 13, relative=False),
        Finer("down_m", 0.03, 7, relative=False),
        Finer("across_m", 0.01, 9, relative=False),
        Finer("modulation_mhz", 0.012, 9),
    )
    LINEAR: ClassVar[tuple[str, ...]] = ("sine_m", "cosine_m")
    CURVE_OF: ClassVar[str] = "range_m"
    CENTRED: ClassVar[bool] = True

    sine_m: float = param(0.0, "amplitude of sin(k phi)", unit="m", low=-0.1, high=0.1)
    cosine_m: float = param(0.0, "amplitude of cos(k phi)", unit="m", low=-0.1, high=0.1)
    modulation_mhz: float = param(
        100.0,
        "frequency whose wave has the fitted period; for a pulsed camera it only states the period",
        unit="MHz",
        low=1.0,
        high=1000.0,
    )

    across_m: float = param(0.0, "increase of the phase from the left to the right border, as range", unit="m", low=-0.5, high=0.5)
    down_m: float = param(0.0, "increase of the phase from the upper to the lower border, as range", unit="m", low=-0.5, high=0.5)
    harmonic: int = param(4, "aliased harmonic: the number of taps", low=1, high=16)
    knots: tuple[float, ...] = ()
    values: tuple[float, ...] = ()
    means: tuple[float, ...] = ()

    @property
    def stated(self) -> str:
        """Amplitude and period; for a curve, its largest values and its range."""
        if self.knots:
            return f"{1e3 * self.swing_m:.1f} mm between the extremes, over ranges of {self.knots[0]:.2f} to {self.knots[-1]:.2f} m, in no regular wave"
        return f"±{1e3 * np.hypot(self.sine_m, self.cosine_m):.1f} mm every {self.period_m:.2f} m of range"

    @property
    def period_m(self) -> float:
        """Metres of range after which the error repeats."""
        return LIGHT_M_PER_S / (2e6 * self.modulation_mhz * self.harmonic)

    def observable(self, frame: Frame) -> Float:
        """Range, metres."""
        return frame.radial

    def columns(self, frame: Frame) -> Float:
        """Sine and cosine of the aliased phase, along z; or the curve's."""
        if self.knots:
            return self.curve_columns(frame)
        camera, rays = frame.camera, frame.rays
        ahead = self.across_m * camera.fx / camera.width * rays[..., 0] + self.down_m * camera.fy / camera.height * rays[..., 1]
        return stack([wave / frame.length for wave in sine_cosine((frame.radial + ahead) / self.period_m)], frame)

    @classmethod
    def lacks(cls, session: Session) -> str:
        """A span of range, if too short."""
        return "" if session.range_span >= LEAST_SPAN_M else f"the ranges span less than {1e3 * LEAST_SPAN_M:.0f} mm"

    @classmethod
    def hypotheses(cls, session: Session) -> Iterator[Form]:
        """Periods that can be distinguished over the session's span of range, in steps of a quarter period over it; or those of stated frequencies.

        Further ones are longer than what a single wave may have: the first terms of the curve of a whole turn of the phase, which all
        cameras have whose calibration table is another's.
        """
        if session.stated_mhz:
            yield from cls._of_frequencies(session)
            return
        for period in periods(session.range_span):
            yield Form(cls(modulation_mhz=LIGHT_M_PER_S / (8e6 * period)), f"period {period * 1e3:.0f} mm")
        for period in longer(session.range_span):
            yield Form(cls(modulation_mhz=LIGHT_M_PER_S / (8e6 * period)), f"period {period * 1e3:.0f} mm", further=True)

    @classmethod
    def _of_frequencies(cls, session: Session) -> Iterator[Form]:
        """The harmonics that three, four and five taps alias, of each stated frequency, where the session sees a whole period; further, the first two."""
        for mhz, harmonic in itertools.product(session.stated_mhz, (*ALIASED, *WHOLE_TURN)):
            wave = cls(modulation_mhz=mhz, harmonic=harmonic)
            further = harmonic in WHOLE_TURN
            longest = 2.0 * session.range_span if further else max(session.range_span, LONGEST_M)
            if SHORTEST_M < wave.period_m < longest:
                yield Form(wave, f"{mhz:g} MHz, harmonic {harmonic}", further=further)


LEAST_SPAN_M = 0.08
"""Least span of range in metres: a quarter of the shortest usual period (c0 / 8f at 120 MHz)."""
ALIASED = (4, 8, 3, 6, 5)
"""Periods in one turn of the phase: harmonics next to a multiple of four are aliased by four taps, next to one of three or five by as many."""
SHORTEST_M, LONGEST_M, MOST_PERIODS = 0.06, 1.0, 40
"""Shortest and longest period that are tried, in metres (c0 / 8f at 620 MHz, above any camera's, and at 37 MHz), and most periods tried.

A longer wave has less than one period in any session, and many other effects cause such a bend over range.
"""
FURTHER_M, MOST_FURTHER = 1.3, 12
"""Shortest period, in metres, and most periods that are tried beside shorter ones: where a refined wave of `LONGEST_M` ends, and as steps over a
span of 4 m have them."""
WHOLE_TURN = (1, 2)
"""Harmonics of a turn of the phase that an error of the calibration table has."""


def longer(span: float) -> list[float]:
    """Periods of at least `FURTHER_M` to try beside shorter ones, metres: from twice the span, neighbours 90 degrees apart over the span."""
    return _spaced(2.0 * span, FURTHER_M, span, MOST_FURTHER)


def periods(span: float) -> Float:
    """Wiggle periods to try, metres: from twice the span (or `LONGEST_M`) down to `SHORTEST_M`, neighbours 90 degrees apart over the span."""
    wide = max(span, 0.2)
    return np.array(_spaced(min(2.0 * wide, LONGEST_M), SHORTEST_M, wide, MOST_PERIODS))


def _spaced(longest: float, shortest: float, span: float, most: int) -> list[float]:
    """At most `most` periods from the longest down to above the shortest, metres, neighbours 90 degrees apart over the span."""
    out, period = list[float](), longest
    while period > shortest:
        out.append(period)
        period = 1.0 / (1.0 / period + 0.25 / span)
    return out[:most]
