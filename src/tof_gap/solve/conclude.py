# SPDX-License-Identifier: Apache-2.0
"""From a joint solution to the input of the report: coefficients of the fit views, maps, and the views at the final poses."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from tof_core.memory import give_back
from tof_gap.seen.evidence.residual import less, noise_again
from tof_gap.seen.missing.steps import beside_steps
from tof_gap.solve.causes import Posed, free_shares, named, smooth_ones
from tof_gap.solve.choose.judge import Selector
from tof_gap.solve.confirmed import confirmed_m, energy_share, seen_share, sizes_m
from tof_gap.solve.hypotheses.candidate import HAND_EYE
from tof_gap.solve.lateness import late_apart
from tof_gap.solve.offset import offset_apart
from tof_gap.solve.solution import delayed, lens_of, solution
from tof_gap.solve.start import observe
from tof_gap.solve.tolerance import calibrated
from tof_gap.solved import Solved
from tof_sensor.effects.fixed_pattern import FixedPattern
from tof_sensor.effects.intrinsics import Intrinsics
from tof_sensor.effects.motion import Motion
from tof_sensor.effects.range_offset import RangeOffset
from tof_sensor.effects.time_sync import TimeSync

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from tof_align.chain import Chain
    from tof_core.arrays import Float
    from tof_core.calibration import Calibration
    from tof_core.camera import Camera
    from tof_core.capture import View
    from tof_gap.config import GapConfig
    from tof_gap.limits.solve import SelectLimits
    from tof_gap.seen.evidence.view import ViewEvidence
    from tof_gap.solve.solution import Joint
    from tof_gap.solved import Named, Split
    from tof_scene.raycast import Raycaster
    from tof_sensor.effect import Effect

UNNAMED_M = 5e-4
"""Least size in metres of errors without a name that count. It is half of what a healthy camera's effects may be, since a function of one observable
describes only a part of an error that is no function of it. Largest of 70 healthy sessions of the emerging camera: 0.22 mm; beside right names:
0.37 mm; gloss without a name, panes and ghosts: 0.76 mm and more."""


def conclude(joint: Joint, views: Sequence[View], caster: Raycaster, config: GapConfig, split: Split, rng: np.random.Generator) -> Solved:
    """Close a joint solution.

    Args:
        joint: poses and selected effects.
        views: as recorded, in the order of the solution.
        caster: the scene.
        config: which pixels are evidence.
        split: coefficients are fitted to the fit views alone.
        rng: for resampling views (confidence).
    """
    judge = Selector(joint.design, config.select)
    found = late_apart(named(joint, split.fit, judge, rng), config.solve.joint.frame_taps, asked=TimeSync.NAME in joint.asked)
    rest = tuple(n for n in found if not calibrated(n, config.calibration, views[0].camera))
    final, there = _chains(joint, rest, config.calibration)
    lens = None if any(n.name == Intrinsics.NAME for n in rest) else lens_of(joint)
    evidence = observe(views, caster, final, config, concavity=True, lens=lens)  # Mixed pixels need exact poses and footprints.
    rest = offset_apart(rest, evidence, 1e-3 * config.select.least_mm, asked=RangeOffset.NAME in joint.asked)
    stated = Posed(evidence, final, caster, config.solve.joint.other_surface_mm * 1e-3)
    maps, free = stated.shares(rest), free_shares(joint, evidence)
    give_back()  # What rendering and mapping have freed.
    still = [n for n in rest if not any(moves_camera(e, views[0].camera) for e in n.effects)]
    # What a pixel errs by is confirmed at the true poses: a highlight is where the camera is.
    true, own, nameless = stated, maps, free
    if moved := len(still) < len(rest):
        true = replace(stated, views=observe(views, caster, there, config, lens=lens_of(joint)), chain=there)
        own, nameless = true.shares(still), free_shares(joint, true.views)
    sizes = sizes_m(maps | free, evidence, split.held_out) | confirmed_m(joint, judge, true, own, nameless, split, config.solve.joint)
    small = _small(_as_seen(sizes, maps, free, evidence, config.select), maps, free, config.select)
    # Errors of a healthy camera are no gap: they are subtracted before anything is stated.
    evidence = less(evidence, [by_view for name, by_view in (maps | free).items() if name in small])
    maps, free = ({name: by_view for name, by_view in one.items() if name not in small} for one in (maps, free))
    causes = [n for n in rest if n.name not in small]
    bare = _subtracted(*(true, still, own, nameless) if moved else (replace(stated, views=evidence), causes, maps, free))
    return Solved(
        camera=views[0].camera,
        caster=caster,
        chain=final,
        cameras=np.stack([there.pose(v) for v in range(len(evidence))]),
        camera_covs=joint.design.system.camera_covs(joint.selection.fit),
        hand_eye=joint.hand_eye,
        evidence=evidence,
        linearised=joint.views,
        named=tuple(causes),
        maps=maps,
        sizes={n.name: sizes[n.name] for n in causes},
        tied=_tied(joint, {n.name for n in causes}),
        bare=_beside_pattern(bare, maps, config) if any(n.name == FixedPattern.NAME for n in rest) else bare,
        unnamed_m=_together_m(sizes, free),
        depends_on=tuple(quantity for quantity in joint.selection.unknown if quantity in free),
        small=tuple(sorted(small | {n.name for n in found} - {n.name for n in rest})),
        small_m={name: sizes[name] for name in small},
        within=tuple(n for n in rest if n.name in small),
        small_together=joint.selection.small_together,
        # Motion shifts edges, and poses by a board's corners share the lens's errors: then equal arm errors are no sign of a loose mount.
        arms_alike=0.0 if Motion.NAME in maps or joint.chain.root is not None else judge.arms_alike(joint.selection.chosen),
        arms=judge.arms(joint.selection.chosen),
        arms_sd=judge.arms_sd,
        split=split,
    )


def _chains(joint: Joint, rest: Sequence[Named], stated: Calibration) -> tuple[Chain, Chain]:
    """The poses that figures are stated at, and the true ones as the solution has them.

    Hand-eye and lateness are effects: figures are stated without them, unless they are within the stated calibration.
    """
    after, late_s = solution(joint)
    final = replace(delayed(after, joint.views, -late_s), hand_eye=_mount(joint, rest, stated))
    return final, delayed(replace(final, hand_eye=joint.hand_eye), joint.views, late_s)


def _subtracted(
    posed: Posed, causes: Sequence[Named], maps: Mapping[str, list[Float]], free: Mapping[str, list[Float]]
) -> tuple[ViewEvidence, ...]:
    """The views less the smooth bias of `causes` and of free functions; maps: of the causes, pixel offsets included."""
    smooth = {**maps, **posed.shares([n for n in smooth_ones(causes) if n not in causes])}
    return less(posed.views, [*smooth.values(), *free.values()])


def _as_seen(
    sizes: Mapping[str, float],
    maps: Mapping[str, Sequence[Float]],
    free: Mapping[str, Sequence[Float]],
    views: Sequence[ViewEvidence],
    limits: SelectLimits,
) -> dict[str, float]:
    """The sizes in metres, that of `motion` times the share of its map that the pixels which it moves show."""
    if Motion.NAME not in maps:
        return dict(sizes)
    share = seen_share(Motion.NAME, {**maps, **free}, views, limits.motion_moved_mm * 1e-3)
    return {**sizes, Motion.NAME: sizes[Motion.NAME] * share}


def _small(sizes: Mapping[str, float], maps: Mapping[str, Sequence[Float]], free: Iterable[str], limits: SelectLimits) -> set[str]:
    """Names of effects within a healthy camera's tolerance, and of `motion` if it explains too little of all, also at edges.

    Errors without a name, `free`, are one error in several terms, and are judged together by the root of the sum of their squares.
    """
    unnamed = set(free)
    least_m = {Motion.NAME: 1e-3 * limits.motion_mm} | dict.fromkeys(unnamed, UNNAMED_M)
    judged = {**sizes, **dict.fromkeys(unnamed, _together_m(sizes, unnamed))}
    small = {name for name, size in judged.items() if size < least_m.get(name, 1e-3 * limits.least_mm)}
    if Motion.NAME in maps and energy_share(Motion.NAME, maps) < limits.share:
        small.add(Motion.NAME)
    return small


def _together_m(sizes: Mapping[str, float], names: Iterable[str]) -> float:
    """Metres: root of the sum of the squares of the sizes of these names."""
    return float(np.sqrt(sum(sizes[name] ** 2 for name in names)))


def _mount(joint: Joint, rest: Sequence[Named], stated: Calibration) -> Float:
    """(4, 4) X for the figures: the solution's if it is within the stated calibration, else the identity."""
    return joint.hand_eye if stated.hand_eye_sd.any() and all(n.name != HAND_EYE for n in rest) else np.eye(4)


def _tied(joint: Joint, names: set[str]) -> tuple[tuple[Effect | None, Effect | None], ...]:
    """Pairs of a member with one of these names, and of an effect that could stand in for it."""
    candidates, selection = joint.design.candidates, joint.selection
    pairs = ((m, other) for m, others in zip(selection.chosen.members, selection.ties, strict=True) for other in others)
    return tuple((candidates[m].effect, candidates[other].effect) for m, other in pairs if candidates[m].name in names)


def moves_camera(effect: Effect, stated: Camera) -> bool:
    """Whether the effect moves the camera or changes its lens, so that pixels see other points."""
    return effect.late_s != 0.0 or is_of_calibration(effect, stated)


def is_of_calibration(effect: Effect, stated: Camera) -> bool:
    """Whether the effect is another mount or another lens than stated."""
    return effect.mount is not None or effect.camera(stated) != stated


def _beside_pattern(bare: Sequence[ViewEvidence], maps: Mapping[str, Sequence[Float]], config: GapConfig) -> tuple[ViewEvidence, ...]:
    """The views after a fixed pattern is subtracted: with sigma estimated again, and without loss at the steps of a named pattern."""
    views, pattern = noise_again(bare), maps.get(FixedPattern.NAME)
    return views if pattern is None else beside_steps(views, pattern, config.missing)
