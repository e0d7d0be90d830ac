# SPDX-License-Identifier: Apache-2.0
"""Temperature drift: the delays of driver and demodulation change while the camera warms up."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from tof_core.config import param
from tof_sensor.action import LATER
from tof_sensor.curve import CurveEffect
from tof_sensor.effect import Finer, Form, stack

if TYPE_CHECKING:
    from collections.abc import Iterator

    from tof_core.arrays import Float
    from tof_sensor.frame import Frame
    from tof_sensor.session import Course, Session


@dataclass(frozen=True, slots=True)
class TemperatureDrift(CurveEffect):
    """dr = k (T - T0) + w exp(-t / tau) + h exp(-t / tau_h) + r (g + p (T - T0) + q exp(-t / tau)) (docs/effects.md).

    The first term follows the thermometer. The next two warm up at other rates: the lamp's driver leads a thermometer in the housing by
    minutes, and the housing lags. Without a thermometer they are the only ones. t is the time since the session's start. A drifting clock
    or delay line causes errors in proportion to the range r: the last three terms, which are not fitted together with the others. With
    `knots`, dr is any function of t, as caused by a fan that starts or by a compensation table.
    """

    NAME: ClassVar[str] = "temperature_drift"
    ORDER: ClassVar[int] = 56
    MEANING: ClassVar[str] = "range drifts while the camera warms up"
    REMEDY: ClassVar[str] = (
        "let the camera warm up before recording, usually for twenty minutes; its depth may settle minutes after its thermometer"
    )
    SEPARATED_BY: ClassVar[str] = "the same pose recorded over half an hour"
    ACTIONS: ClassVar = (LATER,)
    FINER: ClassVar[tuple[Finer, ...]] = (Finer("tau_s", 1.0, 7),)
    LINEAR: ClassVar[tuple[str, ...]] = ("drift_m", "warmup_m", "housing_m", "reference_share", "drift_share", "warmup_share")
    CURVE_OF: ClassVar[str] = "time_s"

    drift_m: float = param(0.0, "drift per kelvin of the thermometer", unit="m", low=-0.1, high=0.1)
    warmup_m: float = param(0.0, "warm-up at the session's start, beside the drift with the thermometer", unit="m", low=-0.2, high=0.2)
    housing_m: float = param(0.0, "second, slower warm-up at the session's start", unit="m", low=-0.2, high=0.2)
    reference_share: float = param(0.0, "constant error in proportion to range, beside a share that drifts", low=-0.2, high=0.2)
    drift_share: float = param(0.0, "drift as a share of range, per kelvin of the thermometer", low=-0.1, high=0.1)
    warmup_share: float = param(0.0, "warm-up as a share of range, at the session's start", low=-0.2, high=0.2)
    gain: bool = param(False, "whether the terms in proportion to range are fitted instead of the others")
    reference_c: float = param(25.0, "temperature without drift", unit="degC", low=-40.0, high=120.0)
    tau_s: float = param(0.0, "time constant of the warm-up; 0: none beside the thermometer", unit="s", low=0.0, high=1e5)
    housing_s: float = param(0.0, "time constant of the second warm-up; 0: none", unit="s", low=0.0, high=1e5)
    knots: tuple[float, ...] = ()
    values: tuple[float, ...] = ()

    @property
    def rest(self) -> str:
        """A constant share of range, or for a curve a constant: neither drifts."""
        if self.gain:
            return "depth_scale"
        return "range_offset" if self.knots else ""

    @property
    def stated(self) -> str:
        """Drift with the thermometer, and warm-up."""
        return " and ".join(self._terms())

    def stated_in(self, course: Course) -> str:
        """`stated` for a session; several terms by their sum at its start and end, since one balances what another has too much.

        So is a warm-up that is slower than the session.
        """
        if self.knots or not np.isfinite(course.seconds):
            return self.stated
        terms, slow = self._terms(), max(self.tau_s, self.housing_s) > course.seconds
        known = np.isfinite([course.first_c, course.last_c]).all() or not (self.drift_m or self.drift_share)
        if not known or (len(terms) == 1 and not (slow and self._warms_up)):
            return self.stated
        size, unit = (100.0, "% of the range") if self.gain else (1e3, "mm")
        digits = 2 if self.gain else 1
        ends = (self._at(0.0, course.first_c), self._at(course.seconds, course.last_c))
        first, last, change = (f"{size * v:+.{digits}f}" for v in (*ends, ends[1] - ends[0]))
        if abs(ends[0]) > OFFSET * abs(ends[1] - ends[0]):
            return f"by {change} {unit} in {course.seconds / 60:.1f} min, beside {first} {unit} from the start on, which may be a constant offset"
        end = ", too slow for a time constant to show" if slow and len(terms) == 1 else ""
        return f"from {first} {unit} at the start to {last} {unit} after {course.seconds / 60:.1f} min{end}"

    @property
    def _warms_up(self) -> bool:
        return bool(self.warmup_m or self.housing_m or self.warmup_share)

    def _terms(self) -> list[str]:
        """Each term by itself, in words."""
        if self.knots:
            return [f"{1e3 * self.swing_m:.1f} mm between the extremes, in no regular course"]
        sizes = ((1e3 * self.drift_m, "+.1f", "mm"), (100 * self.drift_share, "+.2f", "% of the range"))
        shown = [f"{v:{digits}} {unit} a kelvin of the thermometer" for v, digits, unit in sizes if v]
        fading = (
            (1e3 * self.warmup_m, "+.1f", "mm", self.tau_s),
            (1e3 * self.housing_m, "+.1f", "mm", self.housing_s),
            (100 * self.warmup_share, "+.2f", "% of the range", self.tau_s),
        )
        return shown + [
            f"{v:{digits}} {unit} at the start, fading with a time constant of {tau / 60:.1f} min"
            for v, digits, unit, tau in fading
            if v and tau
        ]

    def _at(self, time_s: float, temperature_c: float) -> float:
        """The drift in metres, or as a share of range, at a time of the session and a temperature."""
        warm = temperature_c - self.reference_c if np.isfinite(temperature_c) else 0.0
        warmup, housing = self._faded(time_s)
        if self.gain:
            return self.reference_share + self.drift_share * warm + self.warmup_share * warmup
        return self.drift_m * warm + self.warmup_m * warmup + self.housing_m * housing

    def _faded(self, time_s: float) -> tuple[float, float]:
        """What is left of either warm-up at a time of the session, as a share; 0 for a term that is not fitted."""
        one, other = (float(np.exp(-time_s / tau)) if tau > 0 else 0.0 for tau in (self.tau_s, self.housing_s))
        return one, other

    def observable(self, frame: Frame) -> Float:
        """Seconds since the session's first capture, shape ()."""
        return np.array(frame.context.time_s)

    def columns(self, frame: Frame) -> Float:
        """Along z: three constants per view and three shares of range, 0 for unknown or unfitted terms; or the curve's columns."""
        if self.knots:
            return self.curve_columns(frame)
        context = frame.context
        warm = context.temperature - self.reference_c if np.isfinite(context.temperature) else 0.0
        warmup, housing = self._faded(context.time_s)
        one = np.where(frame.valid, 0.0 if self.gain else 1.0 / frame.length, 0.0)
        range_ = np.where(frame.valid & self.gain, frame.depth, 0.0)
        return stack([one * warm, one * warmup, one * housing, range_, range_ * warm, range_ * warmup], frame)

    @classmethod
    def lacks(cls, session: Session) -> str:
        """A change of temperature, or enough time for one, if missing."""
        if session.warming:
            return ""
        without = int(np.isnan(session.temperatures).sum())
        state = f"{without} of {len(session.views)} views have no temperature" if without else "the temperature is steady"
        return f"{state}, and the session is shorter than 60 s"

    @classmethod
    def hypotheses(cls, session: Session) -> Iterator[Form]:
        """Drift with the thermometer about its mean, alone and with warm-ups.

        With a steady thermometer, only warm-ups that change by a share `CHANGES` during the session: slower ones equal a range offset.
        """
        temperature = session.temperatures
        known = bool(np.isfinite(temperature).all())
        mean = float(temperature.mean()) if known else 25.0
        if known:
            yield Form(cls(reference_c=mean), "thermometer")
        least = 0.0 if session.temperature_changes or not known else CHANGES
        changing = [tau for tau in TIME_CONSTANTS_S if 1.0 - np.exp(-session.duration_s / tau) >= least]
        for tau in changing:
            yield Form(cls(reference_c=mean, tau_s=tau), f"tau {tau:g} s")
        for tau, slower in itertools.combinations(changing, 2):
            yield Form(cls(reference_c=mean, tau_s=tau, housing_s=slower), f"tau {tau:g} s and {slower:g} s")
        if known:
            yield Form(cls(reference_c=mean, gain=True), "gain, thermometer")
        for tau in changing:
            yield Form(cls(reference_c=mean, tau_s=tau, gain=True), f"gain, tau {tau:g} s")


TIME_CONSTANTS_S = (60.0, 300.0, 1200.0)
"""Usual time constants of a lamp's driver, a sensor and a housing, seconds."""
OFFSET = 2.0
"""Ratio of the error at the start to its change over the session, from which most of it may be an offset that does not drift."""
CHANGES = 0.5
"""Least change of a warm-up during a session with a steady thermometer, as a share; a smaller change cannot be distinguished from a constant offset."""
