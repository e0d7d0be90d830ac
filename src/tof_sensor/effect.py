# SPDX-License-Identifier: Apache-2.0
"""The base of all effects: a formula with linear coefficients and a shape, and all that a simulator or a diagnosis needs of an effect."""

from __future__ import annotations

from abc import ABC
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np

from tof_core.config import bounds_of
from tof_sensor.action import Action  # noqa: TC001  (the table of parameters resolves the class's annotations)

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from tof_core.arrays import Float, Ints
    from tof_core.camera import Camera
    from tof_sensor.effects.photon_law import PhotonLaw
    from tof_sensor.frame import Frame
    from tof_sensor.session import Course, Session


class Evidence(Enum):
    """How an effect appears in the data."""

    BIAS = "bias"
    NOISE = "noise"
    MISSING = "missing"


class Form(NamedTuple):
    """One form of an effect that a diagnosis tries, and what distinguishes it from the effect's other forms.

    further: whether it occurs only beside a form that is not, and beside no straight line over range (`Effect.STRAIGHT`).
    """

    effect: Effect
    note: str = ""
    further: bool = False


class Finer(NamedTuple):
    """One pass of the search around a parameter's best value, with an odd number of steps; `width` is a share of it, or in its unit."""

    parameter: str
    width: float
    steps: int = 5
    relative: bool = True

    def near(self, own: float) -> Float:
        """(steps,) values around the parameter's current value."""
        sides = np.linspace(-1, 1, self.steps)
        return np.asarray(own * (1 + self.width) ** sides if self.relative else own + self.width * sides)


@dataclass(frozen=True, slots=True)
class Detection:
    """An effect found by its detector: confidence 0 to 1, standard deviations by parameter, and its size in words."""

    effect: Effect
    confidence: float
    std: dict[str, float] = field(default_factory=dict)
    note: str = ""


class Effect(ABC):
    """Base of all effects; each is a frozen dataclass whose fields are its parameters.

    `LINEAR` names the fields in which the bias is linear (all others are its *shape*): bias = columns(frame) @ coefficients, in metres along
    z, to first order. An effect that adds noise or loses pixels overrides `apply` instead. Parameters carry units and plausible bounds
    (`tof_core.config.param`). The registry finds every effect of `tof_sensor.effects` by itself.
    """

    __slots__ = ()

    NAME: ClassVar[str]
    ORDER: ClassVar[int]  # Unique rank in physical order: part 0, pose 10, light 30, pixel 50, noise 70, output from 80.
    MEANING: ClassVar[str]  # The effect in a plant engineer's words, for the report.
    REMEDY: ClassVar[str] = ""  # What a plant does about the effect, for the report.
    SEPARATED_BY: ClassVar[str] = "a reference of known distance"  # What else separates it, where no capture of `ACTIONS` does.
    ACTIONS: ClassVar[tuple[Action, ...]] = ()  # Captures in which the effect changes differently from similar ones.
    EVIDENCE: ClassVar[Evidence] = Evidence.BIAS
    LINEAR: ClassVar[tuple[str, ...]] = ()
    OWN: ClassVar[tuple[str, ...]] = ()  # Members of `LINEAR` that define the effect; without them it is another one, such as an offset.
    LOCAL: ClassVar[bool] = True  # Whether the bias of a pixel depends on this pixel alone, so that `Frame.take` may thin the view.
    ROUGH: ClassVar[float] = 0.0  # Relative error of its map, as a share of energy, if only a coarse model of it can be computed.
    LACKS: ClassVar[float] = 0.0  # Share of its energy along another effect that its map may lack: an effect beside it explains more.
    LACKS_ON_A_PART: ClassVar[float] = 0.0  # The same along an effect of a single part.
    EXACT: ClassVar[bool] = False  # Whether its map is exact, since it models neither light nor surfaces: residuals are no error of it.
    IN_IMAGE: ClassVar[bool] = False  # Whether its map is the same in all views: what it leaves resembles no effect of range or light.
    UNEVEN: ClassVar[float] = 0.1  # Largest standard deviation of its size over the views, as a share of its mean.
    MODULATED: ClassVar[bool] = False  # Whether only time-of-flight cameras have it, modulated or pulsed; no stereo camera does.
    STRAIGHT: ClassVar[bool] = False  # Whether its error is a straight line over range, alike in all pixels.
    ONE_FORM: ClassVar[bool] = False  # Whether a diagnosis tries it in a single form, which has the default parameters.
    REPEATS: ClassVar[bool] = False  # Whether it may occur several times: once per part, or once per modulation frequency.
    IN_CHAIN: ClassVar[bool] = False  # Whether it is a member of the chain of poses, which the solution estimates instead of columns.
    SMEARS: ClassVar[bool] = False  # Whether it shifts depth edges, and with them the poses that edges determine.
    AT_EDGES: ClassVar[bool] = False  # Whether it is largest at edges, which no fit uses: its size is that of its map on all pixels.
    FINER: ClassVar[tuple[Finer, ...]] = ()  # Passes of the search around its best form, in turn.
    REACH_M: ClassVar[float] = 0.05  # Prior standard deviation of a coefficient, as RMS of its column over the session, metres.
    COEFFICIENTS: ClassVar[tuple[str, ...]] = ()  # Names of the coefficients where they are not those of `LINEAR`.

    @property
    def rough(self) -> float:
        """Relative error of this effect's map, as a share of energy: `ROUGH`, unless its parameters say more."""
        return self.ROUGH

    @property
    def coefficients(self) -> Float:
        """(k,) values of the linear parameters."""
        return np.concatenate([np.atleast_1d(np.asarray(getattr(self, n), float)) for n in self.LINEAR] or [np.zeros(0)])

    @property
    def stated(self) -> str:
        """Its size in words, in the effect's units; empty where millimetres of depth are enough."""
        return ""

    def stated_in(self, course: Course) -> str:
        """`stated` for a session: what its duration and temperatures determine."""
        del course
        return self.stated

    @property
    def remedy(self) -> str:
        """What a plant does about the effect with these parameters."""
        return self.REMEDY

    @property
    def rest(self) -> str:
        """Name of the effect that remains of this form without the terms `OWN`; empty if none does."""
        return ""

    @property
    def rivals(self) -> tuple[str, ...]:
        """Effects that cannot be distinguished from this one with these parameters."""
        return ()

    @property
    def coefficient_names(self) -> tuple[str, ...]:
        """Names of the coefficients, in order."""
        return self.COEFFICIENTS or self.LINEAR

    @property
    def bounds(self) -> tuple[Float, Float]:
        """Plausible (low, high) (k,) of the linear parameters; infinite where none are stated."""
        low, high = np.array([bounds_of(type(self), n) for n in self.LINEAR], float).reshape(-1, 2).T
        return low, high

    def with_coefficients(self, values: Float) -> Effect:
        """The same shape with other linear parameters (k,)."""
        changes: dict[str, Any] = {n: float(v) for n, v in zip(self.LINEAR, values, strict=True)}
        return replace(self, **changes)  # type: ignore[type-var]

    def plausible(self, values: Float) -> Effect:
        """The same shape with coefficients (k,), clipped to their bounds."""
        return self.with_coefficients(np.clip(values, *self.bounds))

    def occurs_beside(self, other: Effect) -> bool:
        """Whether one session may have the effect in this form and in the form `other`."""
        del other
        return self.REPEATS

    @property
    def free_form(self) -> bool:
        """Whether this form is any function of an observable instead of a formula; a diagnosis requires more of such forms."""
        return False

    def prior_sd(self, scale: Float) -> Float:
        """(k,) standard deviations of coefficients times `scale`, the RMS of their columns (k,)."""
        return np.full(len(scale), self.REACH_M)

    # what it does -------------------------------------------------------------------------------
    def columns(self, frame: Frame) -> Float:
        """(H, W, k) change of z in metres per unit of each coefficient; 0 where the effect is absent."""
        return np.zeros((*frame.depth.shape, 0))

    def columns_at(self, frame: Frame, pixels: Ints) -> Float:
        """(n, k) rows of `columns` at chosen pixels (flat indices); computed for these only where possible."""
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
        """(H, W) ratio of published z to the surface's z: 1, unless the effect is one of the lens."""
        return np.ones((stated.height, stated.width))

    @property
    def mount(self) -> Float | None:
        """(4, 4) X of the chain of poses; None if the effect is no motion of the camera in its mount."""
        return None

    @property
    def needs_scene(self) -> bool:
        """Whether it needs the scene: with depth and amplitude alone it is absent."""
        return False

    @property
    def late_s(self) -> float:
        """Seconds by which depth is later than its stamp."""
        return 0.0

    @property
    def makes_outliers(self) -> bool:
        """Whether it causes outliers of single pixels, which a filter in the camera removes."""
        return self.EVIDENCE is Evidence.NOISE

    @property
    def smooth(self) -> Effect:
        """The effect without offsets of single pixels."""
        return self

    def includes(self, other: Effect) -> bool:
        """Whether a camera that is known to have this effect is expected to have `other`, found in another session. Bias is removed instead."""
        del other
        return False

    # noise --------------------------------------------------------------------------------------
    @property
    def constant_variance(self) -> float:
        """Variance that it adds to every pixel of every capture, m^2."""
        return 0.0

    @property
    def in_bursts(self) -> bool:
        """Whether it adds noise to some captures only."""
        return False

    def added_to(self, law: PhotonLaw) -> PhotonLaw:
        """The photon law with the noise that the effect adds to every capture."""
        return replace(law, floor_m=float(np.sqrt(law.floor_m**2 + self.constant_variance))) if self.constant_variance else law

    def noise(self, frame: Frame) -> Float:
        """(H, W) standard deviation of the noise that the effect adds to a capture, RMS over captures, metres of z."""
        return np.asarray(np.sqrt(self.constant_variance) / frame.length)

    # what a diagnosis tries ---------------------------------------------------------------------
    @classmethod
    def hypotheses(cls, session: Session) -> Iterator[Form]:
        """The forms to try on a session."""
        del session
        yield from (Form(cls()),) if cls.ONE_FORM else ()

    @classmethod
    def lacks(cls, session: Session) -> str:
        """What a session lacks for a test of the effect; empty if nothing."""
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
        """The effect if the session's noise shows it; for effects without columns."""
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
        """The same shape with other values (k,); single values have no bounds."""
        return self.with_coefficients(values)


def stack(columns: Sequence[Float], frame: Frame) -> Float:
    """Join (H, W) columns into (H, W, k), 0 where a value is not finite."""
    out = np.stack(columns, axis=-1) if columns else np.zeros((*frame.depth.shape, 0))
    np.copyto(out, 0.0, where=~np.isfinite(out))  # `nan_to_num` takes several times as long.
    return out
