# SPDX-License-Identifier: Apache-2.0
"""What an effect is: a formula with linear coefficients and a shape, and everything else that a simulator or a diagnosis asks of it."""

from __future__ import annotations

from abc import ABC
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np

from tof_sensor.action import Action  # noqa: TC001  (the table of parameters resolves the class's annotations)

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from tof_core.arrays import Float, Ints
    from tof_core.camera import Camera
    from tof_sensor.effects.photon_law import PhotonLaw
    from tof_sensor.frame import Frame
    from tof_sensor.session import Session


class Evidence(Enum):
    """The kind of trace that an effect leaves."""

    BIAS = "bias"
    NOISE = "noise"
    MISSING = "missing"


class Form(NamedTuple):
    """One form of an effect that a diagnosis tries, and what distinguishes it from the effect's other forms."""

    effect: Effect
    note: str = ""


class Finer(NamedTuple):
    """One pass of the search around an effect's best form: a parameter, how far to either side, in how many steps.

    steps: odd, so that the parameter's own value is among them; relative: whether `width` is a share of the parameter, or in its own unit.
    """

    parameter: str
    width: float
    steps: int = 5
    relative: bool = True

    def near(self, own: float) -> Float:
        """(steps,) values around the parameter's own one."""
        sides = np.linspace(-1, 1, self.steps)
        return np.asarray(own * (1 + self.width) ** sides if self.relative else own + self.width * sides)


@dataclass(frozen=True, slots=True)
class Detection:
    """An effect that its own detector found: confidence 0 to 1, standard deviations by parameter, and its size in words."""

    effect: Effect
    confidence: float
    std: dict[str, float] = field(default_factory=dict)
    note: str = ""


class Effect(ABC):
    """Base of all effects; each is a frozen dataclass whose fields are its parameters.

    `LINEAR` names the fields in which the bias is linear (all others are its *shape*):
    bias = columns(frame) @ coefficients, in metres along z, to first order. An effect that adds noise or
    loses pixels overrides `apply` instead. Parameters carry units and plausible bounds
    (`tof_core.config.param`). The registry finds every effect of `tof_sensor.effects` by itself.
    """

    __slots__ = ()

    NAME: ClassVar[str]
    ORDER: ClassVar[int]
    """Place on the light's way, each effect its own: part 0, pose 10, light 30, pixel 50, noise 70, output 80 and on."""
    MEANING: ClassVar[str]
    """The effect in a plant engineer's words, as the report prints them."""
    REMEDY: ClassVar[str] = ""
    """What a plant does about it, as the report prints it."""
    SEPARATED_BY: ClassVar[str] = "a reference of known distance"
    """What would tell the effect from those that look like it, if no capture of `ACTIONS` does."""
    ACTIONS: ClassVar[tuple[Action, ...]] = ()
    """Captures in which the effect changes otherwise than those that look like it."""
    EVIDENCE: ClassVar[Evidence] = Evidence.BIAS
    LINEAR: ClassVar[tuple[str, ...]] = ()
    OWN: ClassVar[tuple[str, ...]] = ()
    """Of `LINEAR`, those without which it would be another effect: an offset, or stamps that are late."""
    LOCAL: ClassVar[bool] = True
    """Whether the bias of a pixel depends on this pixel alone, so that `Frame.take` may thin the view."""
    ROUGH: ClassVar[float] = 0.0  # Share of its own energy by which its map may be wrong, where only a coarse model of it can be computed.
    LACKS: ClassVar[float] = 0.0
    """Share of its own energy along any other effect by which its map may be short: another effect is believed beside it for more."""
    LACKS_ON_A_PART: ClassVar[float] = 0.0  # The same along an effect of one part alone.
    EXACT: ClassVar[bool] = False
    """Whether its map models neither light nor surfaces, so that nothing that is left can be the map's own error."""
    UNEVEN: ClassVar[float] = 0.1  # Spread of its size over the views, over its mean, that is allowed: the camera's formulas have less.
    MODULATED: ClassVar[bool] = False
    """Whether a camera has it only if it times light that it sends, modulated or pulsed: no stereo camera has it."""
    REPEATS: ClassVar[bool] = False
    """Whether it may be there several times at once: once per part, or once per modulation frequency."""
    IN_CHAIN: ClassVar[bool] = False
    """Whether it is a member of the chain of poses, which the solution frees in place of columns."""
    SMEARS: ClassVar[bool] = False
    """Whether it shifts depth edges, and with them the poses that edges determine."""
    AT_EDGES: ClassVar[bool] = False
    """Whether it errs most at edges, which are in no fit: its size is that of its map on all pixels."""
    FINER: ClassVar[tuple[Finer, ...]] = ()
    """Passes of the search around its best form, in turn."""
    REACH_M: ClassVar[float] = 0.05
    """Prior of a coefficient: metres RMS over the session that its column may reach (one standard deviation)."""
    COEFFICIENTS: ClassVar[tuple[str, ...]] = ()  # Names of the coefficients where they are not those of `LINEAR`.

    @property
    def coefficients(self) -> Float:
        """(k,) values of the linear parameters."""
        return np.concatenate([np.atleast_1d(np.asarray(getattr(self, n), float)) for n in self.LINEAR] or [np.zeros(0)])

    @property
    def stated(self) -> str:
        """Its size in the effect's own units, in words; empty where millimetres say it best."""
        return ""

    def stated_in(self, session_s: float) -> str:
        """Its size as a session of so many seconds can tell it: no time that is longer than the session."""
        del session_s
        return self.stated

    @property
    def remedy(self) -> str:
        """What a plant does about it, of these parameters."""
        return self.REMEDY

    @property
    def rest(self) -> str:
        """Name of the effect that this form is without its own terms, empty where it is none."""
        return ""

    @property
    def rivals(self) -> tuple[str, ...]:
        """Effects that cannot be distinguished from it at these parameters."""
        return ()

    @property
    def coefficient_names(self) -> tuple[str, ...]:
        """Names of the coefficients, in order."""
        return self.COEFFICIENTS or self.LINEAR

    @property
    def bounds(self) -> tuple[Float, Float]:
        """Plausible (low, high) (k,) of the linear parameters; infinite where none is stated."""
        fields = type(self).__dataclass_fields__  # type: ignore[attr-defined]
        limits = [fields[n].metadata for n in self.LINEAR]
        low = [-np.inf if m.get("low") is None else m["low"] for m in limits]
        high = [np.inf if m.get("high") is None else m["high"] for m in limits]
        return np.array(low, float), np.array(high, float)

    def with_coefficients(self, values: Float) -> Effect:
        """The same shape with other linear parameters (k,)."""
        changes: dict[str, Any] = {n: float(v) for n, v in zip(self.LINEAR, values, strict=True)}
        return replace(self, **changes)  # type: ignore[type-var]

    def plausible(self, values: Float) -> Effect:
        """The same shape with coefficients (k,), clipped to their bounds."""
        return self.with_coefficients(np.clip(values, *self.bounds))

    @property
    def free_form(self) -> bool:
        """Whether this form has no formula: it is any function of an observable, and pays for that as such functions do."""
        return False

    def prior_sd(self, scale: Float) -> Float:
        """(k,) standard deviations of coefficients times `scale`, the RMS of their columns (k,)."""
        return np.full(len(scale), self.REACH_M)

    # what it does -------------------------------------------------------------------------------
    def columns(self, frame: Frame) -> Float:
        """(H, W, k) metres of z per unit of each coefficient; 0 where it does nothing."""
        return np.zeros((*frame.depth.shape, 0))

    def columns_at(self, frame: Frame, pixels: Ints) -> Float:
        """(n, k) of `columns` on chosen pixels (flat indices), without the rest where that is possible."""
        if self.LOCAL:
            return np.asarray(self.columns(frame.take(pixels))[0])
        full = self.columns(frame)
        return np.asarray(full.reshape(-1, full.shape[-1])[pixels])

    def bias(self, frame: Frame) -> Float:
        """(H, W) metres that the effect adds to the depth."""
        return np.asarray(self.columns(frame) @ self.coefficients)

    def apply(self, frame: Frame, rng: np.random.Generator) -> Frame:
        """The view after the effect; `rng` is for effects that add noise or lose pixels."""
        del rng
        return replace(frame, depth=frame.depth + self.bias(frame))

    def camera(self, stated: Camera) -> Camera:
        """The true camera, if CameraInfo states `stated`: the same, unless the effect changes the lens."""
        return stated

    def published(self, stated: Camera) -> Float:
        """(H, W) z that the camera publishes over the z of the surface that its pixels see: 1, unless the effect is the lens's."""
        return np.ones((stated.height, stated.width))

    @property
    def mount(self) -> Float | None:
        """(4, 4) X of the chain of poses that the effect stands for, None where it leaves the camera in its mount."""
        return None

    @property
    def needs_scene(self) -> bool:
        """Whether it does nothing where depth and amplitude alone are known."""
        return False

    @property
    def late_s(self) -> float:
        """Seconds by which depth is later than its stamp."""
        return 0.0

    @property
    def makes_outliers(self) -> bool:
        """Whether it leaves single pixels far off, which a filter in the camera removes."""
        return self.EVIDENCE is Evidence.NOISE

    @property
    def smooth(self) -> Effect:
        """The effect without offsets of single pixels: the same, unless it has such."""
        return self

    # noise --------------------------------------------------------------------------------------
    @property
    def constant_variance(self) -> float:
        """Variance that it adds to every pixel of every capture, m^2."""
        return 0.0

    @property
    def in_bursts(self) -> bool:
        """Whether it adds noise to some captures and to others none."""
        return False

    def added_to(self, law: PhotonLaw) -> PhotonLaw:
        """The photon law with the noise that the effect adds to every capture."""
        return replace(law, floor_m=float(np.sqrt(law.floor_m**2 + self.constant_variance))) if self.constant_variance else law

    def noise(self, frame: Frame) -> Float:
        """(H, W) metres of z, the standard deviation that a detected effect adds to a capture."""
        return np.zeros(frame.depth.shape)

    # what a diagnosis tries ---------------------------------------------------------------------
    @classmethod
    def hypotheses(cls, session: Session) -> Iterator[Form]:
        """The forms to try on a session; none of an effect that is no bias."""
        del session
        yield from ()

    @classmethod
    def lacks(cls, session: Session) -> str:
        """What a session lacks that a test of the effect needs, empty where it lacks nothing."""
        del session
        return ""

    @classmethod
    def not_testable(cls, session: Session) -> str | None:
        """The reason why a session cannot test the effect, None where it can."""
        if cls.MODULATED and not session.modulated:
            return "the noise grows with the square of range and does not depend on amplitude: this is no time-of-flight camera"
        return cls.lacks(session) or None

    @classmethod
    def detect(cls, session: Session) -> Detection | None:
        """The effect where the session's noise shows it; for effects that have no columns."""
        del session
        return None


class FieldEffect(Effect):
    """An effect whose coefficients are one tuple in the field `values` (a map, a list of parts)."""

    __slots__ = ()

    LINEAR: ClassVar[tuple[str, ...]] = ("values",)

    def with_coefficients(self, values: Float) -> Effect:
        """The same shape with other values (k,)."""
        return replace(self, values=tuple(float(v) for v in values))  # type: ignore[type-var]

    def plausible(self, values: Float) -> Effect:
        """The same shape with other values (k,): no bounds are stated of them one by one."""
        return self.with_coefficients(values)


def stack(columns: Sequence[Float], frame: Frame) -> Float:
    """Join (H, W) columns into (H, W, k), 0 where a value is not finite."""
    if not columns:
        return np.zeros((*frame.depth.shape, 0))
    return np.nan_to_num(np.stack(columns, axis=-1), nan=0.0, posinf=0.0, neginf=0.0)
