# SPDX-License-Identifier: Apache-2.0
"""A simulator's session against a real one: which effects the simulator lacks, exaggerates or adds, and how far the distance shrinks.

Each session is diagnosed at its own poses. The effects fitted to the simulator are evaluated on the real session's views and compared
with the real camera's effects there, so the poses of both sessions need not agree.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from tof_core.shares import in_percent
from tof_gap.seen.noise import least_mm
from tof_gap.tell.difference import LACKS, STRONG, SUPERFLUOUS, WEAK, Against, AgainstLimits, Difference
from tof_gap.tell.levels_apart import Level, Noisy, Seen, mixing_apart, noise_apart, wraps_apart
from tof_gap.tell.loss_apart import Lossy, loss_apart
from tof_gap.tell.maps_apart import OF_SINGLE_PIXELS, Pair
from tof_gap.tell.noise_parts import part_apart
from tof_gap.tell.report import sensor_model
from tof_gap.union import apart, members, with_known
from tof_sensor.effects.fixed_pattern import FixedPattern
from tof_sensor.effects.phase_wrap import PhaseWrap

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_gap.seen.residual import ViewEvidence
    from tof_gap.tell.diagnosis import Diagnosis
    from tof_sensor.model import SensorModel

OF_MAPS = OF_SINGLE_PIXELS | {FixedPattern.NAME}
"""Effects that are compared otherwise than by their coefficients."""


def against(
    real: Diagnosis, simulated: Diagnosis, parts: Sequence[str], limits: AgainstLimits | None = None, known: SensorModel | None = None
) -> Against:
    """Compare two diagnosed sessions of one scene.

    Args:
        real: the camera's session.
        simulated: the simulator's.
        parts: names of the scene's parts, in the scene's order.
        limits: when they differ.
        known: the sensor whose bias was removed from both sessions before they were diagnosed.
    """
    limits, removed = limits or AgainstLimits(), () if known is None else known.effects
    camera, simulator = sensor_model(real), sensor_model(simulated)
    pair = Pair(real, camera, simulator, tuple(parts), limits, simulated.account.figures.unsure2, removed)
    mirrored = Pair(simulated, simulator, camera, tuple(parts), limits, real.account.figures.unsure2, removed)
    taken = pair.same_names(real.causes)
    mirrored.renamed(taken)
    gain = real.config.select.gain
    union = members((real, simulated), taken, pair.unit, OF_MAPS)
    joint = {} if union is None else apart((real, simulated), with_known(union, removed), gain)
    one_sided = set(pair.real_maps) ^ set(pair.simulated_maps)
    for name in one_sided & joint.keys():
        # Only where it differs: of effects that look alike, each session may have another one for the same error.
        if joint[name].differs and min(joint[name].real, joint[name].simulated) >= gain:
            pair.fill(name, joint[name].real, joint[name].simulated)
            mirrored.fill(name, joint[name].simulated, joint[name].real)
    found = [d for n in pair.names if (d := pair.by_coefficients(n, joint[n]) if n in joint else pair.difference(n)) is not None]
    shares = [p.shown([d.effect for d in found]) for p in (pair, mirrored)]
    alike = tuple(d.effect for d in found if any(s[d.effect] < limits.shown for s in shares))
    both = [n for n, a in joint.items() if n in one_sided and n not in {d.effect for d in found} and a.ratio < limits.shown]
    alike = tuple(sorted({*alike, *both}))
    biases = sorted((d for d in found if d.effect not in alike), key=lambda d: -(d.shrink or 0.0))
    distance = pair.distance([n for n in pair.names if n not in alike])
    lost, lost_alike = _loss(pair, simulated, limits)
    return Against(distance, (*biases, *lost, *_levels(pair, simulated, limits, known)), (*alike, *lost_alike))


def _loss(pair: Pair, simulated: Diagnosis, limits: AgainstLimits) -> tuple[list[Difference], list[str]]:
    """Lost pixels of camera and simulator: the difference, or the effect that the pixels of both sessions show alike."""
    real = pair.real
    found = loss_apart(
        Lossy(real.evidence, pair.camera, pair.unit),
        Lossy(simulated.evidence, pair.simulator, 1.0 / pair.unit),
        pair.parts,
        real.config.missing,
        limits.loss,
    )
    if found is None or found.level.within(limits.shares):
        return [], []
    if any(share < limits.shown for share in found.shown):
        return [], [found.level.effect]
    note = f"{in_percent(found.level.real)} of the pixels real, {in_percent(found.level.simulated)} simulated"
    return [_difference(found.level, note)], []


def _levels(pair: Pair, simulated: Diagnosis, limits: AgainstLimits, known: SensorModel | None) -> list[Difference]:
    """Noise, wrapped and mixed pixels of camera and simulator at the light of the real session."""
    seen = Seen([pair.real.evidence[v].frame for v in pair.held], pair.frames, pair.parts)
    wraps, mixing = (f(pair.camera, pair.simulator, seen) for f in (wraps_apart, mixing_apart))
    law, noise = (None if known is None else known.law) or pair.real.law, None
    if law is not None:
        noise = noise_apart(
            Noisy(_quiet(pair.real), pair.camera, 1.0), Noisy(_quiet(simulated), pair.simulator, 1.0 / pair.unit), law, seen
        )
    out = []
    if wraps is not None and abs(wraps.real - wraps.simulated) > limits.wraps and not wraps.within(limits.shares):
        note = f"{in_percent(wraps.real)} of the pixels off by whole periods real, {in_percent(wraps.simulated)} simulated"
        out.append(_difference(wraps, note))
    # A camera that merges its frequencies badly is noisier, too: that noise is no effect of its own, in a diagnosis as here.
    merges = all(d.effect != PhaseWrap.NAME for d in out)
    differs = noise is not None and not noise.within(limits.noise)
    least = least_mm([*pair.real.evidence, *simulated.evidence], pair.real.config.noise)
    if noise is not None and differs and merges and _excess_mm(noise) > least:
        out.append(_difference(noise, f"{noise.real:.2f} mm real, {noise.simulated:.2f} mm simulated in one capture", in_mm=True))
    elif merges and (part := part_apart(_bare(pair.real), _bare(simulated), pair.real.config.noise, limits.noise)):
        of, level = part
        out.append(_difference(level, f"{level.real:.2f} mm real, {level.simulated:.2f} mm simulated {of} in one capture", in_mm=True))
    if mixing is not None and not mixing.within(limits.shares):
        out.append(_difference(mixing, f"{mixing.real:.0f} mm real, {mixing.simulated:.0f} mm simulated at edges", in_mm=True))
    return out


def _bare(session: Diagnosis) -> Sequence[ViewEvidence]:
    """A session's views less all smooth bias."""
    return session.account.solved.bare


def _quiet(session: Diagnosis) -> Sequence[ViewEvidence]:
    """A session's views with the noise of their pixels; beside a fixed pattern the held-out views alone, with the pattern taken off.

    Constant offsets of pixels differ from neighbour to neighbour as noise does, and averaging of captures does not reduce them. In the
    views that the pattern was estimated from, its map holds a part of the noise.
    """
    figures = session.account.figures
    if FixedPattern.NAME not in figures.maps:
        return session.evidence
    return [replace(session.evidence[v], sigma=np.sqrt(figures.noise2[v])) for v in figures.held]


def _excess_mm(noise: Level) -> float:
    """Noise that the noisier session has beyond the other's."""
    return float(np.sqrt(abs(noise.real**2 - noise.simulated**2)))


def _difference(level: Level, note: str, *, in_mm: bool = False) -> Difference:
    manner = {(True, False): LACKS, (False, True): SUPERFLUOUS}.get(level.has, STRONG if level.ratio > 1 else WEAK)
    real, simulated = (level.real, level.simulated) if in_mm else (np.nan, np.nan)
    return Difference(level.effect, manner, real, simulated, level.parts, None, None, note)
