# SPDX-License-Identifier: Apache-2.0
"""Amplitude bias (walk error): dark pixels are measured nearer or farther than bright ones."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from tof_core.config import param
from tof_sensor.action import BRIGHTER, FARTHER, NEARER
from tof_sensor.curve import CurveEffect
from tof_sensor.effect import Finer, Form, stack
from tof_sensor.session import NO_AMPLITUDE

if TYPE_CHECKING:
    from collections.abc import Iterator

    from tof_core.arrays import Float
    from tof_sensor.frame import Frame
    from tof_sensor.session import Session


CALIBRATE = "calibrate the camera's range on surfaces of several albedos, or simulate with sensor.yaml"


@dataclass(frozen=True, slots=True)
class AmplitudeBias(CurveEffect):
    """dr = c + a ln(Q / A0) + b ln(Q / A0)^2 + s (r / 1 m) ln(Q / A0) + d A0 / Q + e Q / A0 with Q = A (1 + k r^2) (Lindner 2010; docs/effects.md).

    The logarithms follow published walk errors, whose slope may change with the range r. The inverse term is charge that arrives late
    independent of the light, the last term photons that hide later ones (pile-up). `form` selects the terms of a fit: `log` the first
    three, `slope` those and s, `inverse` c, a and d, `direct` c, a, b and e. c is the bias at the amplitude A0; as no amplitude is known to
    be free of bias, every A0 describes the same bias. Q is the light in the pixel: the lamp's, of amplitude A, and ambient light, which
    does not decrease with r. With `knots`, dr is any function of ln A.
    """

    NAME: ClassVar[str] = "amplitude_bias"
    ORDER: ClassVar[int] = 52
    MEANING: ClassVar[str] = "dark and bright surfaces are measured at different distances"
    REMEDY: ClassVar[str] = f"{CALIBRATE}; until then trust dark parts less"
    SEPARATED_BY: ClassVar[str] = "surfaces of different albedo at one distance"
    ACTIONS: ClassVar = (BRIGHTER, NEARER, FARTHER)
    MODULATED: ClassVar[bool] = True
    LINEAR: ClassVar[tuple[str, ...]] = ("at_reference_m", "per_ln_m", "per_ln2_m", "slope_m", "inverse_m", "direct_m")
    OWN: ClassVar[tuple[str, ...]] = ("per_ln_m", "per_ln2_m", "slope_m", "inverse_m", "direct_m")
    CURVE_OF: ClassVar[str] = "amplitude"
    FINER: ClassVar[tuple[Finer, ...]] = (Finer("ambient", 3.0), Finer("ambient", 0.5))

    at_reference_m: float = param(0.0, "bias at the reference", unit="m", low=-0.2, high=0.2)
    per_ln_m: float = param(0.0, "bias per e-fold of amplitude", unit="m", low=-0.05, high=0.05)
    per_ln2_m: float = param(0.0, "curvature of the law", unit="m", low=-0.05, high=0.05)
    slope_m: float = param(0.0, "growth of the bias per e-fold with a metre of range", unit="m", low=-0.05, high=0.05)
    inverse_m: float = param(0.0, "bias by late charge at the reference", unit="m", low=-0.1, high=0.1)
    direct_m: float = param(0.0, "bias in proportion to the light, at the reference", unit="m", low=-0.1, high=0.1)
    form: str = param("log", "terms of a fit", choices=("log", "slope", "inverse", "direct"))
    reference: float = param(1.0, "amplitude to which the bias refers, in the camera's unit", low=1e-12)
    ambient: float = param(0.0, "ambient light over the lamp's at 1 m", unit="1/m^2", low=0.0, high=10.0)
    knots: tuple[float, ...] = ()
    values: tuple[float, ...] = ()

    @property
    def rest(self) -> str:
        """A constant offset."""
        return "range_offset"

    @property
    def remedy(self) -> str:
        """A calibration; first what to do about the end of the curve that is off: weak light measured nearer, or bright light.

        Weak light is measured nearer by what reflects before the lens; late charge and slow comparators do the reverse.
        """
        weak, usual, bright = self._at_light()
        # A term that grows with the light may as well straighten a curve in weak light: then bright surfaces are off the other way.
        saturates = self.form != "direct" or (bright - usual) * self.direct_m > 0.0
        if saturates and abs(bright - usual) > abs(weak - usual):
            return f"{EXPOSURE}; otherwise {CALIBRATE}; until then trust bright parts less"
        return f"{WINDOW}; otherwise {self.REMEDY}" if weak < usual else self.REMEDY

    def _at_light(self) -> tuple[float, float, float]:
        """Bias in metres in weak, usual and bright light, at a range of 1 m; for a curve, at its ends and in its middle."""
        if self.knots:
            return self.values[0], float(np.interp(0.5 * (self.knots[0] + self.knots[-1]), self.knots, self.values)), self.values[-1]
        weak, usual, bright = np.stack(self._terms(np.log([WEAK, 1.0, BRIGHT]), np.ones(3)), axis=1) @ self.coefficients
        return float(weak), float(usual), float(bright)

    def observable(self, frame: Frame) -> Float:
        """ln A, A in the camera's unit; NaN without returned light."""
        return np.log(np.where(frame.amplitude > 0, frame.amplitude, np.nan))

    def columns(self, frame: Frame) -> Float:
        """Along z: constant, log of the light, its square, log times range, inverse, light; 0 for terms not in `form`; or the curve's columns.

        0 without returned light.
        """
        if self.knots:
            return self.curve_columns(frame)
        light = frame.amplitude * (1 + self.ambient * np.nan_to_num(frame.radial) ** 2)
        log = np.log(np.maximum(light, 1e-12) / self.reference)
        seen = frame.valid & (frame.amplitude > 0)
        return stack([np.where(seen, term, 0) / frame.length for term in self._terms(log, np.nan_to_num(frame.radial))], frame)

    def _terms(self, log: Float, radial: Float) -> tuple[Float, ...]:
        """What each of `LINEAR` is multiplied by, at the log of the light over the reference and at ranges in metres, both of one shape."""
        zero = np.zeros_like(log)
        square = zero if self.form == "inverse" else log * log
        slope = log * radial if self.form == "slope" else zero
        inverse = np.minimum(np.exp(-log), DARKEST) if self.form == "inverse" else zero
        direct = np.exp(log) if self.form == "direct" else zero
        return np.ones_like(log), log, square, slope, inverse, direct

    @classmethod
    def lacks(cls, session: Session) -> str:
        """The amplitude image, if missing."""
        return "" if session.has_amplitude else NO_AMPLITUDE

    @classmethod
    def hypotheses(cls, session: Session) -> Iterator[Form]:
        """Each form with the session's median amplitude as reference; `log` and `inverse` also with ambient light."""
        for form in ("log", "slope", "inverse", "direct"):
            for ambient in (0.0, AMBIENT) if form in ("log", "inverse") else (0.0,):
                yield Form(cls(reference=session.median_amplitude, form=form, ambient=ambient), f"{form}, ambient light {ambient:g}")


WEAK, BRIGHT = 0.2, 4.0
"""Light, over the reference, at which weak and bright light are compared with usual light."""
EXPOSURE = "shorten the exposure first: bright surfaces are off, as where pixels are near saturation"
WINDOW = (
    "clean the camera's window and cover glass first: weak surfaces are measured too near, as where the camera's own light is thrown back "
    "before the lens"
)
DARKEST = 100.0
"""Upper bound of A0 / Q: darker pixels return no depth."""
AMBIENT = 0.3
"""First value of ambient light, relative to the lamp's at 1 m: a lit hall and a lamp of some watts, 1/m^2."""
