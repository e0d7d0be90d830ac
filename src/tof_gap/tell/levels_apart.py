# SPDX-License-Identifier: Apache-2.0
"""What two sensor models do to the same views where no mean depth shows it: noise, wrapped pixels, mixed pixels at edges."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tof_sensor.effect import Evidence
from tof_sensor.effects.ambient import Ambient
from tof_sensor.effects.flying_pixels import FlyingPixels
from tof_sensor.effects.noise import Noise
from tof_sensor.effects.phase_wrap import PhaseWrap
from tof_sensor.effects.photon_law import PhotonLaw
from tof_sensor.effects.quantization import Quantization

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from tof_core.arrays import Float
    from tof_gap.seen.residual import ViewEvidence
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


LEAST_PIXELS = 50
"""Pixels of a part in either session from which its noise is compared: the median of as many is known to a tenth."""


@dataclass(frozen=True, slots=True)
class Noisy:
    """A session's views, its sensor, and the real camera's unit of amplitude over the session's own."""

    views: Sequence[ViewEvidence]
    model: SensorModel
    unit: float


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


def noise_apart(real: Noisy, simulated: Noisy, law: PhotonLaw, seen: Seen) -> Level | None:
    """Median in mm of the noise of one capture along the ray, at the light of the real session; None where a session shows none.

    Each session's noise is measured in its own views, as a ratio to one photon law: two laws fitted at different amplitudes differ
    by more where they are extrapolated than the cameras do. The median, since the darkest pixels dominate a mean. The level's name is
    the named effect of which the noisier camera has most more than the other; `noise` without one.
    """
    over, own, part = _over_law(real, law)
    other_over, _, other_part = _over_law(simulated, law)
    if not len(over) or not len(other_over):
        return None
    level = 1e3 * float(np.sqrt(np.median(over * own)))
    ratio = _ratio(over, other_over)
    parts = {}
    for i in np.intersect1d(part, other_part):
        here, there = part == i, other_part == i
        if i >= 0 and min(here.sum(), there.sum()) >= LEAST_PIXELS:
            size = 1e3 * float(np.sqrt(np.median((over * own)[here])))
            parts[seen.parts[i]] = size * abs(1.0 - _ratio(over[here], other_over[there]))
    shares = [_noise_shares(s.model, frames) for s, frames in ((real, seen.own), (simulated, seen.other))]
    more, less = (shares[0], shares[1]) if ratio < 1.0 else (shares[1], shares[0])
    named = {name: v - less.get(name, 0.0) for name, v in more.items()}
    name = max(named, key=named.__getitem__, default=Noise.NAME)
    return Level(name, level, level * ratio, parts, (name in shares[0], name in shares[1]))


def ambient_apart(real: Noisy, simulated: Noisy, law: PhotonLaw, seen: Seen, healthy: float) -> Level | None:
    """Noise of foreign light in mm of one capture along the ray, at the light of the real session: what exceeds the camera's stated law.

    None where the diagnosis of the noisier session does not name `ambient`. The other session has it, too, if its variance exceeds the
    law by a share of more than `healthy`, and no other noise is named there.
    """
    over, own, _ = _over_law(real, law)
    other_over, _, _ = _over_law(simulated, law)
    if not len(over) or not len(other_over):
        return None
    excess = [max(float(np.median(o)) - 1.0, 0.0) for o in (over, other_over)]
    named = [_noise_shares(s.model, frames).keys() for s, frames in ((real, seen.own), (simulated, seen.other))]
    if Ambient.NAME not in named[int(excess[1] > excess[0])]:
        return None
    has = [Ambient.NAME in n or (not n and e > healthy) for n, e in zip(named, excess, strict=True)]
    one_mm, other_mm = (1e3 * float(np.sqrt(e * np.median(own))) for e in excess)
    return Level(Ambient.NAME, one_mm, other_mm, {}, (has[0], has[1]))


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


def _over_law(session: Noisy, law: PhotonLaw) -> tuple[Float, Float, NDArray[np.int16]]:
    """(n,) of a session's smooth pixels: noise variance of one capture over the law's, the law's in m^2 along the ray, the part."""
    over, own, part = [], [], []
    for v in session.views:
        s, frame = v.smooth, v.frame
        predicted = law.variance(session.unit * frame.amplitude[s], frame.surroundings_m2[s])
        measured = v.view.captures * (v.sigma[s] * frame.length[s]) ** 2
        over.append(measured / predicted)
        own.append(predicted)
        part.append(frame.rendering.part[s])
    return np.concatenate(over), np.concatenate(own), np.concatenate(part)


def _ratio(over: Float, other: Float) -> float:
    """Noise of the other session over that of the first, from variances over one law."""
    return float(np.sqrt(np.median(other) / max(float(np.median(over)), 1e-12)))


def _noise_shares(model: SensorModel, frames: Sequence[Frame]) -> dict[str, float]:
    """m^2 of noise of one capture along the ray by each named noise effect of a model: median over the CAD's pixels."""
    out: dict[str, float] = {}
    for effect in model.effects:
        if effect.EVIDENCE is Evidence.NOISE and not isinstance(effect, PhotonLaw):
            values = np.concatenate([((effect.noise(f) * f.length) ** 2)[f.valid] for f in frames])
            out[effect.NAME] = out.get(effect.NAME, 0.0) + float(np.median(values))
    return out


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
