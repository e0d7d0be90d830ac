# SPDX-License-Identifier: Apache-2.0
"""Base class of the virtual camera's effects: a physical size, and the steps of the pipeline at which it acts."""

# ruff: noqa: ARG002  (the methods of the base class do nothing with their arguments)
from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar
from zlib import crc32

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from tof_core.arrays import Float, Mask
    from tof_core.camera import Camera
    from tof_virtual.body import Body
    from tof_virtual.config import VirtualConfig
    from tof_virtual.optics import Echo, Light
    from tof_virtual.session import Session
    from tof_virtual.sight import Rays, Sight, World
    from tof_virtual.taps import Charge

UNIT_M = 3e-3
"""Error at a strength of 1: metres RMS over the affected pixels."""


@dataclass(slots=True, eq=False)
class Moment:
    """True state of one capture: what the camera sees, time, temperature.

    `sights` is one, or five where the camera moves between the taps: each tap's, then the middle of the exposure.
    """

    index: int
    view: int
    time_s: float
    temperature: float
    world: World
    config: VirtualConfig
    camera: Camera
    sights: tuple[Sight, ...]
    lights: dict[object, list[Light]] = field(default_factory=dict)
    """Light on the pixels, by active effects: the same for all captures of a dwell."""

    @property
    def sight(self) -> Sight:
        """What is seen at the middle of the exposure."""
        return self.sights[-1]


@dataclass(slots=True, eq=False)
class Frame:
    """Measurement of a moment: depth (P,) in metres as stored, NaN where invalid; amplitude (P,); saturated (P,)."""

    depth: Float
    amplitude: Float
    saturated: Mask


class Effect:
    """An effect of the vocabulary. Each method is one step of the pipeline; in the base class none does anything.

    Attributes:
        name: its name in the vocabulary.
        unit: the unit of `size`.
        start: a size that gives about a strength of 1, from which calibration begins.
        limit: sizes beyond this are not physical; calibration stops there.
        local: whether the affected pixels are few (then those with a tenth of the usual largest error count).
        kind: "bias", or the quantity that `level` returns: "scatter" (noise; also the prefix in truth files) or "loss".
        geometric: whether it changes what is seen rather than what is measured.
        deforms: whether it changes the bodies.
        natural: whether `size` is `start` times the strength without calibration.
        size: the physical size in force; rms_m: the error it makes, where it was calibrated.
    """

    name: ClassVar[str] = ""
    unit: ClassVar[str] = ""
    start: ClassVar[float] = 1.0
    limit: ClassVar[float] = np.inf
    local: ClassVar[bool] = False
    kind: ClassVar[str] = "bias"
    geometric: ClassVar[bool] = False
    deforms: ClassVar[bool] = False
    natural: ClassVar[bool] = False

    def __init__(self, strength: float, config: VirtualConfig) -> None:
        """Draw what is random about the effect; `size` starts at the strength times `start`."""
        self.strength = strength
        self.config = config
        self.size = self.start * strength
        self.rms_m = float("nan")
        self.draw(self.rng(0))

    def rng(self, index: int) -> np.random.Generator:
        """This effect's own random numbers, the same whenever asked for the same capture."""
        return np.random.default_rng([self.config.seed, crc32(self.name.encode()), index])

    def draw(self, rng: np.random.Generator) -> None:
        """Draw what is fixed for the session: signs, phases, parts."""

    @classmethod
    def adapt(cls, config: VirtualConfig) -> VirtualConfig:
        """The configuration that this effect needs to be visible."""
        return config

    def prepare(self, session: Session) -> None:
        """Set what depends on the planned views."""

    def params(self) -> dict[str, Any]:
        """The physical truth, for the truth file."""
        return {}

    # geometry -----------------------------------------------------------------------------------
    def deform(self, bodies: Sequence[Body]) -> Sequence[Body]:
        """The parts as they really are."""
        return bodies

    def true_camera(self, camera: Camera) -> Camera:
        """The real lens behind the published calibration."""
        return camera

    def hand_eye(self) -> Float:
        """The real X."""
        return np.eye(4)

    def stamp_error_s(self) -> float:
        """What is added to the true time to give the stamp."""
        return 0.0

    def tap_interval_s(self) -> float:
        """Time between taps."""
        return 0.0

    # light --------------------------------------------------------------------------------------
    def reflect(self, echo: Echo, rays: Rays, moment: Moment) -> None:
        """Change the reflection of a surface."""

    def footprint(self) -> float:
        """Side of a pixel's footprint in pixels if the light of all its surfaces is summed, 0 if only the main surface counts."""
        return 0.0

    def spread(self, light: Light, sight: Sight, moment: Moment) -> None:
        """Add light that arrived on another path."""

    # pixel --------------------------------------------------------------------------------------
    def harmonics(self) -> tuple[complex, complex]:
        """Amplitude and phase of the waveform's third and fifth harmonic, relative to the fundamental."""
        return 0j, 0j

    def expose(self, charge: Charge, moment: Moment) -> None:
        """Change what the taps collect or the phase the pixel adds."""

    # output -------------------------------------------------------------------------------------
    def disturb(self, distance: Float, amplitude: Float, moment: Moment) -> Float:
        """Change the measured distance (P,) along the ray; noise-free runs omit terms of mean zero."""
        return distance

    def add_noise(self, distance: Float, amplitude: Float, moment: Moment) -> Float:
        """Add noise to the distance (P,); noisy runs only."""
        return distance

    def lose(self, frame: Frame, moment: Moment) -> Mask | None:
        """Pixels (P,) that are lost."""
        return None

    def level(self, moment: Moment) -> Float | None:
        """For an effect that is not a bias: its noise in metres, or the share of captures lost, per pixel (P,)."""
        return None

    def finish(self, depth: Float, moment: Moment) -> Float:
        """Change the depth as it is stored."""
        return depth


def affected(bias: Float | NDArray[np.float64], *, local: bool) -> Mask:
    """Pixels that count in the RMS of an effect: all valid ones, of a local effect those with a tenth of its 99.5 % error."""
    valid = np.isfinite(bias)
    if not local or not valid.any():
        return valid
    return np.asarray(valid & (np.abs(bias) > 0.1 * np.percentile(np.abs(bias[valid]), 99.5)))


def rms(bias: Float, *, local: bool) -> float:
    """RMS of a bias over the affected pixels, 0 if there are none."""
    chosen = bias[affected(bias, local=local)]
    return float(np.sqrt(np.mean(chosen**2))) if chosen.size else 0.0
