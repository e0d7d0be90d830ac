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
from tof_gap.compare.calibration import as_calibrated, mounts_differ
from tof_gap.compare.comparison import Against, undecided, unnamed
from tof_gap.compare.difference import LACKS, STRONG, SUPERFLUOUS, WEAK, AgainstLimits, Difference
from tof_gap.compare.levels import Level, Seen, mixing_apart, steps_apart, wraps_apart
from tof_gap.compare.light import light_apart
from tof_gap.compare.loss import Lossy, loss_apart
from tof_gap.compare.maps import OF_SINGLE_PIXELS, Pair
from tof_gap.compare.noise import made_by, noise_apart, not_comparable
from tof_gap.compare.second import as_fitted, enlarged
from tof_gap.compare.tied import same_effect, ties
from tof_gap.compare.union import apart, members, with_known
from tof_gap.seen.finding import not_expected
from tof_gap.tell.report.files import sensor_model, without_depth
from tof_sensor.effects.dropout import Dropout
from tof_sensor.effects.fixed_pattern import FixedPattern
from tof_sensor.effects.hand_eye import HandEye
from tof_sensor.effects.noise import Noise
from tof_sensor.effects.phase_wrap import PhaseWrap
from tof_sensor.effects.quantization import Quantization

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from tof_core.arrays import Float
    from tof_gap.compare.difference import Apart
    from tof_gap.compare.second import AsFitted
    from tof_gap.compare.union import Member
    from tof_gap.tell.diagnosis import Diagnosis
    from tof_sensor.effect import Effect
    from tof_sensor.frame import Frame
    from tof_sensor.model import SensorModel

OF_MAPS = OF_SINGLE_PIXELS | {FixedPattern.NAME}
"""Effects that are compared otherwise than by their coefficients."""


def against(
    real: Diagnosis,
    simulated: Diagnosis,
    parts: Sequence[str],
    limits: AgainstLimits | None = None,
    known: SensorModel | None = None,
    left_out: frozenset[str] = frozenset(),
) -> Against:
    """Compare two diagnosed sessions of one scene.

    Args:
        real: the camera's session.
        simulated: the simulator's.
        parts: names of the scene's parts, in the scene's order.
        limits: when they differ.
        known: the sensor whose bias was removed from both sessions before they were diagnosed.
        left_out: names of effects that are not considered.
    """
    limits, removed = limits or AgainstLimits(), () if known is None else known.holding_in(real.solved.caster.scene.digest).effects
    gain, sides = real.config.select.gain, (real, simulated)
    pair, mirrored, taken = _paired(real, simulated, tuple(parts), limits, removed)
    union = members(sides, taken, pair.unit, OF_MAPS)
    joint: dict[str, Apart] = {}
    if union is not None:
        union = enlarged(sides, with_known(union, removed), pair.unit, OF_MAPS | left_out)
        joint = apart(sides, union, gain)
        _seen(sides, union, joint, (pair, mirrored), gain)
    one_sided = set(pair.real_maps) ^ set(pair.simulated_maps)
    for name in one_sided & joint.keys():
        _fill(name, joint[name], (pair, mirrored), gain)
    in_own_unit = {HandEye.NAME} if mounts_differ(real, simulated) else set[str]()
    trials = (pair.by_coefficients(n, joint[n]) if n in joint else pair.difference(n, of_size=n not in in_own_unit) for n in pair.names)
    found = [d for d in trials if d is not None]
    # Free poses take up a mount: what is left of it shows errors of the maps.
    hidden = _not_shown([d.effect for d in found], (pair, mirrored), limits) - in_own_unit
    missed = {n for n, a in joint.items() if n in one_sided and n not in {d.effect for d in found} and a.ratio < limits.shown}
    stated = as_calibrated(real, simulated)
    alike, tied = (hidden | missed) - set(stated), ties(real.causes, simulated.causes, taken)
    biases = [replace(d, ties=tied.get(d.effect, ())) for d in found if d.effect not in (*alike, *stated)]
    biases.sort(key=lambda d: -(d.shrink or 0.0))
    distance = pair.distance([n for n in pair.names if n not in (*alike, *stated)])
    lost, lost_alike = _loss(pair, simulated, limits)
    differences = (*biases, *lost, *_levels(pair, simulated, limits, known, biases))
    both = _sizes_of_both(pair, simulated)
    same = {*alike, *lost_alike, *both} - {d.effect for d in differences} - set(stated)
    sizes = {name: both[name] for name in sorted(same & both.keys())}
    within = {name: pair.sizes_mm(name) for name, a in joint.items() if a.within_maps}
    return Against(
        distance,
        differences,
        tuple(sorted(same)),
        stated,
        sizes,
        (unnamed(real), unnamed(simulated)),
        _untested(real, simulated, known),
        None if Dropout.NAME in {d.effect for d in differences} | same else _missing(real, simulated, limits),
        within,
        undecided((real.verdict, simulated.verdict), differences, {*same, *stated, *within}),
    )


def _not_shown(names: Sequence[str], pairs: tuple[Pair, Pair], limits: AgainstLimits) -> set[str]:
    """Differences of maps that the views of one session do not show, whatever its poses are."""
    return {name for pair in pairs for name, share in pair.shown(names).items() if share < limits.shown}


def _paired(
    real: Diagnosis, simulated: Diagnosis, parts: tuple[str, ...], limits: AgainstLimits, removed: Sequence[Effect]
) -> tuple[Pair, Pair, dict[str, str]]:
    """The maps of both on the real session's views and on the simulator's, and of tied effects the name under which both are compared."""
    camera, simulator = sensor_model(real), sensor_model(simulated)
    pair = Pair(real, camera, simulator, parts, limits, simulated.account.figures.unsure2, removed)
    mirrored = Pair(simulated, simulator, camera, parts, limits, real.account.figures.unsure2, removed)
    taken = same_effect(real.causes, simulated.causes, (pair.real_maps.keys(), pair.simulated_maps.keys()))
    pair.renamed(taken)
    mirrored.renamed(taken)
    return pair, mirrored, taken


def _fill(name: str, found: Apart, pairs: tuple[Pair, Pair], gain: float) -> None:
    """Give the session whose diagnosis did not name an effect its map, where its coefficients show it.

    Only where it differs: of effects that look alike, each session may have another one for the same error.
    """
    if found.differs and min(found.real, found.simulated) >= gain:
        pairs[0].fill(name, found.real, found.simulated)
        pairs[1].fill(name, found.simulated, found.real)


def _missing(real: Diagnosis, simulated: Diagnosis, limits: AgainstLimits) -> tuple[float, float] | None:
    """Shares of the CAD's pixels without depth in both sessions; None where they do not differ."""
    shares = without_depth(real), without_depth(simulated)
    more, less = max(shares), min(shares)
    return shares if more - less > limits.loss and more > limits.shares * less else None


def _sizes_of_both(pair: Pair, simulated: Diagnosis) -> dict[str, tuple[float, float]]:
    """Effects that both sessions have, with their RMS in mm in either; NaN for those of noise, loss and edges, which have no map."""
    found = [{f.name for f in not_expected(side.findings)} for side in (pair.real, simulated)]
    return dict.fromkeys(found[0] & found[1], (np.nan, np.nan)) | {
        n: pair.sizes_mm(n) for n in pair.real_maps.keys() & pair.simulated_maps.keys()
    }


def _untested(real: Diagnosis, simulated: Diagnosis, known: SensorModel | None) -> dict[str, str]:
    """Effects that the simulator's session cannot test, with the reason. Its noise is compared without a photon law, too."""
    noise = not_comparable(real, simulated, known)
    others = {name: why for name, why in simulated.not_testable.items() if name != Noise.NAME}
    return others | ({Noise.NAME: noise} if noise else {})


def _seen(sides: Sequence[Diagnosis], union: Sequence[Member], joint: Mapping[str, Apart], pairs: tuple[Pair, Pair], gain: float) -> None:
    """Give both sessions the maps of those effects that neither diagnosis named: where their coefficients have a chi-square of `gain`."""
    new = joint.keys() - set(pairs[0].names)
    if not new:
        return
    effects = [as_fitted(session, union, side) for side, session in enumerate(sides)]
    for name in new:
        has = joint[name].real >= gain, joint[name].simulated >= gain
        for side, pair in enumerate(pairs):
            maps = [_maps(effects[at][name], pair.frames_seen, side) if has[at] else None for at in (side, 1 - side)]
            pair.add(name, *maps)


def _maps(effects: Sequence[AsFitted], frames: Sequence[Frame], side: int) -> list[Float]:
    """(H, W) metres of z of effects together in views of the real (0) or simulated (1) session."""
    return [np.sum([e.bias(frame, side) for e in effects], axis=0) for frame in frames]


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


def _levels(
    pair: Pair, simulated: Diagnosis, limits: AgainstLimits, known: SensorModel | None, biases: Sequence[Difference]
) -> list[Difference]:
    """Steps, noise, wrapped and mixed pixels of camera and simulator at the light of the real session; biases: in which both differ."""
    seen = Seen([pair.real.evidence[v].frame for v in pair.held], pair.frames, pair.parts)
    wraps, mixing = (f(pair.camera, pair.simulator, seen) for f in (wraps_apart, mixing_apart))
    mixes = mixing is not None and not mixing.within(limits.shares)
    out = []
    if wraps is not None and abs(wraps.real - wraps.simulated) > limits.wraps and not wraps.within(limits.shares):
        note = f"{in_percent(wraps.real)} of the pixels off by whole periods real, {in_percent(wraps.simulated)} simulated"
        if not (mixing is not None and mixes and _unfiltered(wraps, mixing)):
            out.append(_difference(wraps, note))
    light = light_apart(pair.real, simulated, limits.shares)
    if light is not None:
        note = f"{light.real:.2f} mm real, {light.simulated:.2f} mm simulated, other in each capture"
        out.append(_difference(light, note, in_mm=True))
    steps = steps_apart(
        pair.real.evidence, simulated.evidence, (Quantization.NAME in pair.camera.names, Quantization.NAME in pair.simulator.names)
    )
    if steps is not None and not steps.within(limits.shares):
        out.append(_difference(steps, f"steps of {steps.real:.1f} mm real, {steps.simulated:.1f} mm simulated", in_mm=True))
    # A camera that merges its frequencies badly is noisier, too: that noise is no effect of its own, in a diagnosis as here.
    merges = all(d.effect != PhaseWrap.NAME for d in out)
    noise = noise_apart(pair, simulated, limits, known, seen) if merges else None
    if noise is not None and noise[1].effect not in {d.effect for d in out} and not made_by(noise[1], pair, simulated, [*biases, *out]):
        of, level = noise
        out.append(_difference(level, f"{level.real:.2f} mm real, {level.simulated:.2f} mm simulated {of}in one capture", in_mm=True))
    if mixing is not None and mixes:
        out.append(_difference(mixing, f"{mixing.real:.0f} mm real, {mixing.simulated:.0f} mm simulated at edges", in_mm=True))
    return out


def _unfiltered(wraps: Level, mixing: Level) -> bool:
    """Whether more wrapped pixels are those of a filter that is off: it removes mixed pixels and wrapped ones.

    Then one of both has no mixed pixels, and both have wrapped ones, the other more of them.
    """
    return all(wraps.has) and mixing.has in ((True, False), (False, True)) and mixing.has[0] == (wraps.real > wraps.simulated)


def _difference(level: Level, note: str, *, in_mm: bool = False) -> Difference:
    manner = {(True, False): LACKS, (False, True): SUPERFLUOUS}.get(level.has, STRONG if level.ratio > 1 else WEAK)
    real, simulated = (level.real, level.simulated) if in_mm else (np.nan, np.nan)
    return Difference(level.effect, manner, real, simulated, level.parts, None, None, note)
