# SPDX-License-Identifier: Apache-2.0
"""Amplitude bias (walk error): dark pixels are measured nearer or farther than bright ones."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from tof_core.config import param
from tof_sensor.action import BRIGHTER, FARTHER, NEARER
from tof_sensor.effect import Effect, Form, stack

if TYPE_CHECKING:
    from collections.abc import Iterator

    from tof_core.arrays import Float
    from tof_sensor.frame import Frame
    from tof_sensor.session import Session


@dataclass(frozen=True, slots=True)
class AmplitudeBias(Effect):
    """dr = c + a ln(A / A0) + b ln(A / A0)^2 (Lindner 2010; docs/effects.md).

    c is the bias at the amplitude A0: where none is stated to be free of bias, every A0 describes the same bias.
    """

    NAME: ClassVar[str] = "amplitude_bias"
    ORDER: ClassVar[int] = 52
    MEANING: ClassVar[str] = "dark and bright surfaces are measured at different distances"
    SEPARATED_BY: ClassVar[str] = "surfaces of different albedo at one distance"
    ACTIONS: ClassVar = (BRIGHTER, NEARER, FARTHER)
    MODULATED: ClassVar[bool] = True
    LINEAR: ClassVar[tuple[str, ...]] = ("at_reference_m", "per_ln_m", "per_ln2_m")
    OWN: ClassVar[tuple[str, ...]] = ("per_ln_m", "per_ln2_m")

    at_reference_m: float = param(0.0, "bias at the reference", unit="m", low=-0.2, high=0.2)
    per_ln_m: float = param(0.0, "bias per e-fold of amplitude", unit="m", low=-0.05, high=0.05)
    per_ln2_m: float = param(0.0, "curvature of the law", unit="m", low=-0.05, high=0.05)
    reference: float = param(1.0, "amplitude to which the bias refers, in the camera's unit", low=1e-12)

    def columns(self, frame: Frame) -> Float:
        """One, log amplitude and its square, along z; 0 where no light came back."""
        log = np.log(np.maximum(frame.amplitude, 1e-12) / self.reference)
        seen = frame.valid & (frame.amplitude > 0)
        return stack([np.where(seen, power, 0) / frame.length for power in (np.ones_like(log), log, log * log)], frame)

    @classmethod
    def lacks(cls, session: Session) -> str:
        """An amplitude image."""
        return "" if session.has_amplitude else "no amplitude image"

    @classmethod
    def hypotheses(cls, session: Session) -> Iterator[Form]:
        """One form, about the session's median amplitude."""
        yield Form(cls(reference=session.median_amplitude))
