# SPDX-License-Identifier: Apache-2.0
"""What two sensor models do to the same views where no mean depth shows it: steps of the depth code, wrapped pixels, mixed pixels at edges."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tof_sensor.effects.flying_pixels import FlyingPixels
from tof_sensor.effects.phase_wrap import PhaseWrap
from tof_sensor.effects.quantization import Quantization

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from tof_core.arrays import Float
    from tof_gap.seen.evidence.view import ViewEvidence
    from tof_sensor.frame import Frame
    from tof_sensor.model import SensorModel


@dataclass(frozen=True, slots=True)
class Level:
    """What the real and the simulated camera have of an effect, in one unit (mm of noise, share of pixels), and the difference by part.

    has: whether the camera and the simulator were found to have the effect at all.
    """

    effect: str
    real: float
    simulated: float
    parts: dict[str, float]
    has: tuple[bool, bool]

    @property
    def ratio(self) -> float:
        """Simulated over real."""
        return self.simulated / max(self.real, 1e-9)

    def within(self, factor: float) -> bool:
        """Whether the two differ by less than a factor."""
        return 1 / factor < self.ratio < factor


@dataclass(frozen=True, slots=True)
class Seen:
    """The real session's views as both cameras see them.

    own, other: the same views, with the amplitude of the real and of the simulated camera; parts: names of the scene's parts.
    """

    own: Sequence[Frame]
    other: Sequence[Frame]
    parts: Sequence[str]

    def of_both(self, value: Callable[[SensorModel, Frame], Float], real: SensorModel, simulated: SensorModel) -> tuple[Float, Float]:
        """(n,) values of both models at the CAD's pixels of all views."""
        rows = [np.concatenate([value(m, f)[f.valid] for f in frames]) for m, frames in ((real, self.own), (simulated, self.other))]
        return rows[0], rows[1]

    @property
    def part(self) -> NDArray[np.int16]:
        """(n,) indices of the parts at the CAD's pixels of all views."""
        return np.concatenate([f.rendering.part[f.valid] for f in self.own])


def steps_apart(real: Sequence[ViewEvidence], simulated: Sequence[ViewEvidence], has: tuple[bool, bool]) -> Level | None:
    """Step in mm of the depth codes of both cameras; None where neither is coarse.

    The step itself is read off the codes. The noise that it makes may be hidden by more noise of another kind.

    Args:
        real: the camera's views.
        simulated: the simulator's.
        has: whether camera and simulator were found to write coarse steps.
    """
    if not any(has):
        return None
    steps = [1e3 * float(np.median([v.step_m for v in views])) for views in (real, simulated)]
    return Level(Quantization.NAME, steps[0], steps[1], {}, has)


def wraps_apart(real: SensorModel, simulated: SensorModel, seen: Seen) -> Level | None:
    """Share of the CAD's pixels that are off by a period; None where neither camera has such pixels."""
    return _share_apart(PhaseWrap.NAME, _wrapped, real, simulated, seen)


def mixing_apart(real: SensorModel, simulated: SensorModel, seen: Seen) -> Level | None:
    """RMS in mm of what mixing adds to the mixed pixels at the CAD's edges; None where both cameras filter such pixels."""
    level = _share_apart(FlyingPixels.NAME, _mixed2, real, simulated, seen)
    if level is None:
        return None
    mixed = np.concatenate([(np.nan_to_num(f.rendering.mixed) > 0)[f.valid] for f in seen.own]).mean()
    rms = [1e3 * float(np.sqrt(v / max(mixed, 1e-9))) for v in (level.real, level.simulated)]
    return Level(level.effect, rms[0], rms[1], {}, level.has)


def _share_apart(
    name: str, value: Callable[[SensorModel, Frame], Float], real: SensorModel, simulated: SensorModel, seen: Seen
) -> Level | None:
    """Mean of a value of both models over the CAD's pixels; None where neither model has the effect."""
    has = name in real.names, name in simulated.names
    if not any(has):
        return None
    own, other = seen.of_both(value, real, simulated)
    return mean_level(name, own, other, seen.part, seen.parts, has)


def mean_level(name: str, own: Float, other: Float, part: NDArray[np.int16], parts: Sequence[str], has: tuple[bool, bool]) -> Level:
    """Means of both cameras' values (n,) over all pixels, and the difference on each part; part (n,): indices into `parts`."""
    apart = {parts[i]: abs(float((own - other)[part == i].mean())) for i in np.unique(part) if i >= 0}
    return Level(name, float(own.mean()), float(other.mean()), apart, has)


def _wrapped(model: SensorModel, frame: Frame) -> Float:
    """(H, W) probability that a pixel is off by a period."""
    out = np.zeros(frame.depth.shape)
    for effect in model.effects:
        if isinstance(effect, PhaseWrap):
            out = np.where(effect.beyond(frame), effect.share, out)
    return out


def _mixed2(model: SensorModel, frame: Frame) -> Float:
    """(H, W) m^2 that mixing adds to the mixed pixels."""
    return sum((e.bias(frame) ** 2 for e in model.effects if isinstance(e, FlyingPixels)), np.zeros(frame.depth.shape))
