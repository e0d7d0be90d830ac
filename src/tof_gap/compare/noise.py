# SPDX-License-Identifier: Apache-2.0
"""Noise of most pixels in two sessions: over one photon law, or, where they share none, as the captures of their dwells differ."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from tof_gap.compare.levels import Level
from tof_gap.compare.noise_parts import OF_PIXELS, part_apart
from tof_gap.seen.evidence.residual import noise_again
from tof_gap.seen.noise.dwells import between_captures2
from tof_gap.seen.noise.photons import least_mm
from tof_sensor.effect import Evidence
from tof_sensor.effects.ambient import Ambient
from tof_sensor.effects.cad_deviation import CadDeviation
from tof_sensor.effects.fixed_pattern import FixedPattern
from tof_sensor.effects.interference import Interference
from tof_sensor.effects.noise import Noise
from tof_sensor.effects.photon_law import PhotonLaw
from tof_sensor.effects.quantization import Quantization
from tof_sensor.effects.wiggling import Wiggling

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from tof_core.arrays import Float
    from tof_gap.compare.difference import AgainstLimits, Difference
    from tof_gap.compare.levels import Seen
    from tof_gap.compare.maps import Pair
    from tof_gap.seen.evidence.view import ViewEvidence
    from tof_gap.tell.diagnosis import Diagnosis
    from tof_sensor.frame import Frame
    from tof_sensor.model import SensorModel

LEAST_PIXELS = 50
"""Pixels of a part in either session from which its noise is compared: the median of as many is known to a tenth."""
MAKE_NOISE = frozenset({FixedPattern.NAME, Quantization.NAME, Interference.NAME})
"""Effects that are no noise, and of which more makes more noise."""


@dataclass(frozen=True, slots=True)
class Noisy:
    """A session's views, its sensor, and the real camera's unit of amplitude over the session's own."""

    views: Sequence[ViewEvidence]
    model: SensorModel
    unit: float


def noise_apart(pair: Pair, simulated: Diagnosis, limits: AgainstLimits, known: SensorModel | None, seen: Seen) -> tuple[str, Level] | None:
    """Noise in which both differ: of what, and its level; that of most pixels, else of lines or of single pixels.

    Noise of whole lines is in every pixel: where it makes most of that difference, it is what differs. Foreign light may be little beside
    the camera's own noise: then the light is compared alone.
    """
    real, law = pair.real, _shared_law(pair.real, simulated, known)
    sides = Noisy(_quiet(real), pair.camera, 1.0), Noisy(_quiet(simulated), pair.simulator, 1.0 / pair.unit)
    level = captures_apart(*sides, seen, limits.absent) if law is None else over_law_apart(*sides, law, seen, limits.absent)
    least = least_mm([*real.evidence, *simulated.evidence], real.config.noise)
    unit = pair.unit if _has_amplitude(real) == _has_amplitude(simulated) else None
    found = part_apart(bare(real), bare(simulated), real.config.noise, limits.noise, limits.absent, unit)
    of_part = None if found is None else (f"{found[0]} ", found[1])
    if (
        found is not None
        and found[0] != OF_PIXELS
        and level is not None
        and _excess_mm(found[1]) ** 2 > limits.of_lines * _excess_mm(level) ** 2
    ):
        return of_part
    if level is not None and not level.within(limits.noise) and _excess_mm(level) > least:
        return "", level
    if law is not None and known is not None and known.law is not None and level is not None and not level.within(limits.light):
        light = ambient_apart(*sides, law, seen, real.config.noise.law_excess)
        if light is not None and not light.within(limits.shares) and _excess_mm(light) > least:
            return "beyond the photon law ", light
    return of_part


def not_comparable(real: Diagnosis, simulated: Diagnosis, known: SensorModel | None) -> str:
    """Why the noise of most pixels of two sessions cannot be compared; empty where it can."""
    sides = {"camera's": real, "simulator's": simulated}
    single = [name for name, side in sides.items() if not _between(side.evidence)]
    if _shared_law(real, simulated, known) is not None or not single:
        return ""
    dark = [name for name, side in sides.items() if not _has_amplitude(side)]
    why = f"no amplitude image in the {dark[0]} bag" if dark else "no photon law in the camera's bag"
    return f"{why}, and one capture a stop in the {' and the '.join(single)}: two captures or more of each stop, each with noise of its own, make it comparable"


def _shared_law(real: Diagnosis, simulated: Diagnosis, known: SensorModel | None) -> PhotonLaw | None:
    """The photon law that the noise of both is compared with; None where only one of them has an amplitude image.

    Without an image, amplitudes are those of the CAD's albedo, in a unit of their own.
    """
    law = (None if known is None else known.law) or real.law
    return law if _has_amplitude(real) == _has_amplitude(simulated) else None


def _has_amplitude(session: Diagnosis) -> bool:
    return any(v.view.amplitude is not None for v in session.evidence)


def over_law_apart(real: Noisy, simulated: Noisy, law: PhotonLaw, seen: Seen, absent: float) -> Level | None:
    """Median in mm of the noise of one capture along the ray, at the light of the real session; None where a session shows none.

    Each session's noise is measured in its own views, as a ratio to one photon law: two laws fitted at different amplitudes differ
    by more where they are extrapolated than the cameras do. The median, since the darkest pixels dominate a mean.
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
    name, has = _name(real, simulated, seen, level, level * ratio, absent)
    return Level(name, level, level * ratio, parts, has)


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


def captures_apart(real: Noisy, simulated: Noisy, seen: Seen, absent: float) -> Level | None:
    """Median in mm of the noise of one capture along the ray, as the captures of each session's dwells differ; None without dwells in one.

    No law of amplitude is needed. The views of both have other ranges, so photon noise differs with them.
    """
    sides = [_between(s.views) for s in (real, simulated)]
    if not all(sides):
        return None
    (own2, part), (other2, other_part) = ([np.concatenate(column) for column in zip(*side, strict=True)] for side in sides)
    sizes = [_median_mm(v2) for v2 in (own2, other2)]
    parts = {
        seen.parts[i]: abs(_median_mm(own2[part == i]) - _median_mm(other2[other_part == i]))
        for i in np.intersect1d(part, other_part)
        if i >= 0 and min((part == i).sum(), (other_part == i).sum()) >= LEAST_PIXELS
    }
    name, has = _name(real, simulated, seen, sizes[0], sizes[1], absent)
    return Level(name, sizes[0], sizes[1], parts, has)


def _between(views: Sequence[ViewEvidence]) -> list[tuple[Float, NDArray[np.int16]]]:
    """Variance of one capture in m^2 along the ray as captures differ, and part, of the smooth pixels (n,) of each dwell."""
    out = []
    for v in views:
        if v.view.captures > 1:
            shown = v.smooth & np.isfinite(v.view.sigma) & (v.view.count > 1)
            out.append((between_captures2(v)[shown], v.frame.rendering.part[shown]))
    return out


def _median_mm(variance: Float) -> float:
    return 1e3 * float(np.sqrt(np.median(variance)))


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


def _name(real: Noisy, simulated: Noisy, seen: Seen, own: float, other: float, absent: float) -> tuple[str, tuple[bool, bool]]:
    """The named effect of which the noisier camera has most more than the other, and whether each has it; `noise` without one.

    Noise without a name is in both, unless that of one is less than a share of `absent` of the other's.
    """
    shares = [_noise_shares(s.model, frames) for s, frames in ((real, seen.own), (simulated, seen.other))]
    more, less = (shares[0], shares[1]) if other < own else (shares[1], shares[0])
    named = {name: v - less.get(name, 0.0) for name, v in more.items()}
    if not named:
        return Noise.NAME, (own >= absent * other, other >= absent * own)
    name = max(named, key=named.__getitem__)
    return name, (name in shares[0], name in shares[1])


def _noise_shares(model: SensorModel, frames: Sequence[Frame]) -> dict[str, float]:
    """m^2 of noise of one capture along the ray by each named noise effect of a model: median over the CAD's pixels."""
    out: dict[str, float] = {}
    for effect in model.effects:
        if effect.EVIDENCE is Evidence.NOISE and not isinstance(effect, PhotonLaw):
            values = np.concatenate([((effect.noise(f) * f.length) ** 2)[f.valid] for f in frames])
            out[effect.NAME] = out.get(effect.NAME, 0.0) + float(np.median(values))
    return out


def bare(session: Diagnosis) -> Sequence[ViewEvidence]:
    """A session's views less all smooth bias."""
    return session.account.solved.bare


def _quiet(session: Diagnosis) -> Sequence[ViewEvidence]:
    """A session's views with the noise of their pixels; beside a fixed pattern the held-out views alone, with the pattern taken off.

    Beside parts that do not stand as the CAD, it is read again without their error: what differs between neighbours there is no noise.
    Constant offsets of pixels differ from neighbour to neighbour as noise does, and averaging of captures does not reduce them. In the
    views that the pattern was estimated from, its map holds a part of the noise.
    """
    figures = session.account.figures
    if FixedPattern.NAME not in figures.maps:
        return noise_again(bare(session)) if CadDeviation.NAME in figures.maps else bare(session)
    return [replace(session.evidence[v], sigma=np.sqrt(figures.noise2[v])) for v in figures.held]


def _excess_mm(noise: Level) -> float:
    """Noise that the noisier session has beyond the other's."""
    return float(np.sqrt(abs(noise.real**2 - noise.simulated**2)))


def made_by(noise: Level, pair: Pair, simulated: Diagnosis, differences: Sequence[Difference]) -> bool:
    """Whether more noise is what more fixed pattern, coarser steps, or a weaker modulation of the light make.

    The camera's filters change the offsets of pixels from view to view: what a map of the pattern misses grows with the pattern. Coarse
    steps make contours, and another camera's light is noise as well. The diagnosis of the noisier session decides whether it has noise besides.
    """
    of_real = noise.real > noise.simulated
    noisier = pair.real if of_real else simulated
    more = {d.effect for d in differences if (d.real_mm > d.simulated_mm) == of_real}
    own = [f.name for f in noisier.findings if f.effect.EVIDENCE is Evidence.NOISE and f.name not in MAKE_NOISE]
    return (bool(more & MAKE_NOISE) and not own) or (Wiggling.NAME in more and _of_weak_modulation(noise, pair.light))


def _of_weak_modulation(noise: Level, light: float) -> bool:
    """Whether the noisier camera has less amplitude of the same albedo, by a ratio no less than that of the noise.

    A pulse that is too long, or a driver that is too slow, weakens the modulation beside its error over range. As much light returns,
    with its photon noise, and the amplitude falls: the noise of the phase grows by the inverse ratio, and by less over a photon law.
    light: amplitude of one albedo in the simulator, over that of the camera.
    """
    more, dimmer = (1.0 / noise.ratio, light) if noise.real > noise.simulated else (noise.ratio, 1.0 / light)
    return more <= dimmer
