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
    """dr = c + a ln(A / A0) + b ln(A / A0)^2 + d A0 / A (Lindner 2010; docs/effects.md).

    The logarithms follow published walk errors, the inverse charge that arrives late whatever the light. `form` says which of them a
    fit may use: `log` the first three, `inverse` c, a and d. c is the bias at the amplitude A0: where none is stated to be free of bias, every A0 describes the same bias.
    """

    NAME: ClassVar[str] = "amplitude_bias"
    ORDER: ClassVar[int] = 52
    MEANING: ClassVar[str] = "dark and bright surfaces are measured at different distances"
    REMEDY: ClassVar[str] = (
        "calibrate the camera's range on surfaces of several albedos, or simulate with sensor.yaml; until then trust dark parts less"
    )
    SEPARATED_BY: ClassVar[str] = "surfaces of different albedo at one distance"
    ACTIONS: ClassVar = (BRIGHTER, NEARER, FARTHER)
    MODULATED: ClassVar[bool] = True
    LINEAR: ClassVar[tuple[str, ...]] = ("at_reference_m", "per_ln_m", "per_ln2_m", "inverse_m")
    OWN: ClassVar[tuple[str, ...]] = ("per_ln_m", "per_ln2_m", "inverse_m")
    REST: ClassVar[str] = "range_offset"

    at_reference_m: float = param(0.0, "bias at the reference", unit="m", low=-0.2, high=0.2)
    per_ln_m: float = param(0.0, "bias per e-fold of amplitude", unit="m", low=-0.05, high=0.05)
    per_ln2_m: float = param(0.0, "curvature of the law", unit="m", low=-0.05, high=0.05)
    inverse_m: float = param(0.0, "bias by late charge at the reference", unit="m", low=-0.1, high=0.1)
    form: str = param("log", "terms of a fit", choices=("log", "inverse"))
    reference: float = param(1.0, "amplitude to which the bias refers, in the camera's unit", low=1e-12)

    def columns(self, frame: Frame) -> Float:
        """One, log amplitude, its square, and inverse amplitude, along z; 0 where no light came back and for terms that `form` lacks."""
        log = np.log(np.maximum(frame.amplitude, 1e-12) / self.reference)
        seen = frame.valid & (frame.amplitude > 0)
        zero = np.zeros_like(log)
        inverse = np.minimum(np.exp(-log), DARKEST)
        terms = (np.ones_like(log), log, zero, inverse) if self.form == "inverse" else (np.ones_like(log), log, log * log, zero)
        return stack([np.where(seen, term, 0) / frame.length for term in terms], frame)

    @classmethod
    def lacks(cls, session: Session) -> str:
        """An amplitude image."""
        return "" if session.has_amplitude else "no amplitude image"

    @classmethod
    def hypotheses(cls, session: Session) -> Iterator[Form]:
        """Either form, about the session's median amplitude."""
        for form in ("log", "inverse"):
            yield Form(cls(reference=session.median_amplitude, form=form), form)


DARKEST = 100.0
"""Cap of A0 / A: darker pixels return no depth."""
