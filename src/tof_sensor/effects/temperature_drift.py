# SPDX-License-Identifier: Apache-2.0
"""Temperature drift: driver and demodulation delay change while the camera warms up."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from tof_core.config import param
from tof_sensor.action import LATER
from tof_sensor.effect import Effect, Form, stack

if TYPE_CHECKING:
    from collections.abc import Iterator

    from tof_core.arrays import Float
    from tof_sensor.frame import Frame
    from tof_sensor.session import Session


@dataclass(frozen=True, slots=True)
class TemperatureDrift(Effect):
    """dr = k (T - T0), or w exp(-t / tau) where the temperature is unknown (docs/effects.md)."""

    NAME: ClassVar[str] = "temperature_drift"
    ORDER: ClassVar[int] = 56
    MEANING: ClassVar[str] = "range drifts while the camera warms up"
    SEPARATED_BY: ClassVar[str] = "the same pose recorded over half an hour"
    ACTIONS: ClassVar = (LATER,)
    LINEAR: ClassVar[tuple[str, ...]] = ("drift_m",)

    drift_m: float = param(0.0, "per kelvin; without a thermometer at power-on", unit="m", low=-0.1, high=0.1)
    reference_c: float = param(25.0, "temperature without drift", unit="degC", low=-40.0, high=120.0)
    tau_s: float = param(600.0, "time constant used where temperature is unknown", unit="s", low=1.0, high=1e5)

    def columns(self, frame: Frame) -> Float:
        """One constant per view, along z."""
        context = frame.context
        warm = context.temperature - self.reference_c
        level = warm if np.isfinite(warm) else float(np.exp(-context.time_s / self.tau_s))
        return stack([np.where(frame.valid, level, 0.0) / frame.length], frame)

    @classmethod
    def lacks(cls, session: Session) -> str:
        """A change of temperature, or time for one."""
        return "" if session.warming else "temperature steady or unknown, and under 60 s"

    @classmethod
    def hypotheses(cls, session: Session) -> Iterator[Form]:
        """By the thermometer about its mean; without one, three time constants."""
        temperature = session.temperatures
        if np.isfinite(temperature).all():
            yield Form(cls(reference_c=float(temperature.mean())))
            return
        for tau in (60.0, 300.0, 1200.0):
            yield Form(cls(tau_s=tau), f"tau {tau:g} s")
