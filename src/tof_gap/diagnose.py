# SPDX-License-Identifier: Apache-2.0
"""The diagnosis of one session: where it differs from its simulation, which effects cause that, how far the gap shrinks."""

from __future__ import annotations

from functools import partial
from types import MappingProxyType
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from tof_align.folds import deal
from tof_core.errors import RefusedError
from tof_core.memory import give_back
from tof_gap.seen.evidence.between_points import HIDDEN, between_points, hides_loss
from tof_gap.seen.evidence.field import within_field
from tof_gap.seen.evidence.residual import less
from tof_gap.seen.noise.own_law import own_law
from tof_gap.solve.apart import set_apart, thin_apart
from tof_gap.solve.conclude import conclude
from tof_gap.solve.hypotheses.candidate import HAND_EYE
from tof_gap.solve.hypotheses.candidates import not_testable
from tof_gap.solve.joint import with_small, without
from tof_gap.solve.radial import gate
from tof_gap.solve.start import as_rectified
from tof_gap.solve.stray import solve_agreeing
from tof_gap.solved import Split
from tof_gap.steps import FIRST, HELD_OUT, TOGETHER, UNEXPLAINED
from tof_gap.tell.account import account, without_causes
from tof_gap.tell.contradicted import TakenOut, taken_out
from tof_gap.tell.diagnosis import Diagnosis, doubted
from tof_gap.tell.figures.explainable import explainable
from tof_gap.tell.objects import unexplained_objects
from tof_gap.tell.report.absent import absent
from tof_gap.tell.unexplained import look
from tof_scene.world.words import described
from tof_sensor.effects.dropout import Dropout
from tof_sensor.effects.fixed_pattern import FixedPattern
from tof_sensor.effects.flying_pixels import FlyingPixels
from tof_sensor.effects.motion import Motion
from tof_sensor.effects.radial_depth import RadialDepth
from tof_sensor.registry import VOCABULARY
from tof_sensor.stated import NOTHING_STATED

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from tof_align.chain import Chain
    from tof_align.config import AlignConfig
    from tof_core.capture import View
    from tof_gap.config import GapConfig
    from tof_gap.limits.report import ReportLimits
    from tof_gap.limits.solve import SolveLimits
    from tof_gap.seen.finding import Finding
    from tof_gap.solve.solution import Joint
    from tof_gap.solve.start import Start
    from tof_gap.solved import Bound
    from tof_gap.tell.account import Account
    from tof_gap.tell.unexplained import Unexplained
    from tof_scene.raycast import Raycaster
    from tof_sensor.effects.photon_law import PhotonLaw
    from tof_sensor.stated import StatedNoise


def diagnose(
    views: Sequence[View],
    caster: Raycaster,
    config: GapConfig,
    align: AlignConfig,
    left_out: frozenset[str] = frozenset(),
    progress: Callable[[str], None] = lambda _: None,
    *,
    untestable: Mapping[str, str] = MappingProxyType({}),
    stated: StatedNoise = NOTHING_STATED,
    given: Sequence[Finding] = (),
) -> Diagnosis:
    """Diagnose a session.

    Args:
        views: of one camera, in bag order, each with its robot pose and station.
        caster: the scene.
        config: when an effect is believed.
        align: the robot's priors.
        left_out: effects not to be considered (a test of `unknown`).
        progress: called with the name of each step.
        untestable: effects that this kind of session cannot have, each with the reason; none of them is considered.
        stated: the camera's photon law and loss of pixels, where they are known; else a law is fitted to the session.
        given: findings that the views are corrected for already, such as a lens that the corners of a board contradict.

    Raises:
        RefusedError: the session fits the scene nowhere, or fewer views than `solve.views` do not even show distance along the ray.
    """
    check(views, config.solve.views)
    left_out = left_out | untestable.keys() | {f.name for f in given}
    few, rng = len(views) < config.solve.views, np.random.default_rng(config.evidence.seed)
    progress(FIRST)
    begun, along_ray = gate(within_field(between_points(views)), caster, config, align, asked=RadialDepth.NAME not in left_out)
    check_enough(views, along_ray, config.solve.views)
    recorded, (world, begun) = begun.views, set_apart(begun, caster, config, align)
    read = partial(account, rng=rng, along_ray=along_ray, given=given, alone=few, left_out=left_out, stated=stated)
    asked = frozenset(VOCABULARY) if few else left_out
    answer = partial(answered, caster=caster, config=config, left_out=asked, stated=stated, read=read, rng=rng, progress=progress)
    one = answer(as_rectified(begun, caster, config))
    del begun
    if one.unexplained.structured and (thin := thin_apart(world, one.views, one.found.solved, one.config)) is not None:
        del one
        world, begun = thin
        one = answer(begun)
    found, unexplained, config = one.found, one.unexplained, one.config
    not_tested = too_few(len(one.views)) if few else untested(found, config, stated.law, left_out) | dict(untestable)
    return Diagnosis(
        verdict(found, unexplained, config.report),
        without_causes(found) if doubted(unexplained, config.report) else found,
        explainable(found.solved.evidence, found.figures.left(), found.solved.split, found.gap, config.report.explainable),
        unexplained,
        not_tested,
        law_beside(found, config),
        config,
        described(unexplained_objects(world, recorded, found), caster.scene),
        one.stray,
        absent(found, one.bounds, {*not_tested, *left_out, *one.resembled}),
    )


class Answer(NamedTuple):
    """A solution as it is believed.

    found: its account; unexplained: what no named effect explains; resembled: names of causes that the views contradict; config: its settings;
    views: what it was solved from; stray: indices of the stray views among them; bounds: what each effect that is not named stays below.
    """

    found: Account
    unexplained: Unexplained
    resembled: list[str]
    config: GapConfig
    views: Sequence[View]
    stray: tuple[int, ...]
    bounds: Mapping[str, Bound]


def answered(
    begun: Start,
    caster: Raycaster,
    config: GapConfig,
    left_out: frozenset[str],
    stated: StatedNoise,
    read: Callable[..., Account],
    rng: np.random.Generator,
    progress: Callable[[str], None],
) -> Answer:
    """Solve a session from its start, take out what is not believed, and judge what is left; read: the account of a solution with `config`."""
    progress(TOGETHER)
    joint, config, views, stray = solve_agreeing(begun, caster, config, left_out)
    split, bounds = dealt(joint.chain, config.solve), joint.bounds
    progress(HELD_OUT)
    found, resembled = believed(joint, lambda chosen: read(conclude(chosen, views, caster, config, split, rng), config=config), config)
    del joint
    give_back()
    progress(UNEXPLAINED)
    unexplained = look(found, caster.scene, config.report, config.missing, resembled, stated.removed_mm)
    return Answer(found, unexplained, resembled, config, views, stray, bounds)


def believed(joint: Joint, read: Callable[[Joint], Account], config: GapConfig) -> tuple[Account, list[str]]:
    """The account of the solution without causes that are not believed, and the names of causes that the views contradict."""
    found, resembled = read(joint), list[str]()
    while (taken := unconfirmed(joint, found) or taken_out(found, config)) is not None:
        resembled += [taken.name] if taken.contradicted else []
        joint = without(joint, taken.name, config)
        del found  # Images of all views are most of a session's memory.
        found = read(joint)
    if joint.selection.fullest and not (found.solved.named or resembled):
        # Where nothing is named, small effects are errors of a healthy camera, however many there are: none of them is unexplained.
        # An effect that the views contradict is none of these.
        del found
        found = read(with_small(joint, config))
        if found.solved.named:
            del found
            found = read(joint)
    return found, resembled


def unconfirmed(joint: Joint, found: Account) -> TakenOut | None:
    """A suspected effect that the held-out views do not confirm: the others were fitted beside it and are fitted again without it."""
    suspected = {joint.design.candidates[m].name for m in joint.selection.suspected}
    name = next((n for n in found.solved.small if n in suspected), None)
    return None if name is None else TakenOut(name, contradicted=False)


def verdict(found: Account, unexplained: Unexplained, limits: ReportLimits) -> tuple[str, ...]:
    """Names of effects, that which changes depth most first; `unknown` last, where structure is left; `none` without any.

    If much is unexplained, causes are not named.
    """
    names = found.names(causes=not doubted(unexplained, limits))
    return (*names, *(("unknown",) if unexplained.structured else ())) or ("none",)


def too_few(views: int) -> dict[str, str]:
    """All effects but `radial_depth`, each with the reason that there are too few views."""
    return {name: f"{views} views are too few" for name in VOCABULARY if name != RadialDepth.NAME}


def untested(found: Account, config: GapConfig, law: PhotonLaw | None, left_out: frozenset[str]) -> dict[str, str]:
    """Effects that the session cannot test and that nothing else shows, with the reason; none of `left_out`."""
    beside_motion = {
        FlyingPixels.NAME: "motion mixes edges by itself: record at rest",
        HAND_EYE: "motion shifts what poses are known by: record at rest",
    }
    reasons = not_testable(found.solved.bare, config.noise, law, config.stated_mhz, left_out)
    if found.solved.names(Motion.NAME):
        reasons |= beside_motion
    if hides_loss(found.solved.bare):
        reasons |= {Dropout.NAME: HIDDEN}
    shown = {*found.names(causes=True), *left_out}
    return {name: reason for name, reason in reasons.items() if name not in shown}


def law_beside(found: Account, config: GapConfig) -> PhotonLaw | None:
    """The photon law that stands beside the named effects in sensor.yaml: the stated law where noise was compared with it, else one fitted to the session."""
    stated = next((f.beside for f in found.findings if f.beside is not None), None)
    if stated is not None:
        return stated
    views, named, wrong2 = found.solved.evidence, [f.effect for f in found.findings], None
    if FixedPattern.NAME in found.solved.maps:  # Offsets of pixels and lines are noise to their neighbours.
        views = less(views, [found.solved.maps[FixedPattern.NAME]])
        fitted = np.isin(np.arange(len(views)), found.solved.split.fit)
        wrong2 = np.where(fitted, -1.0, 1.0) * float(found.figures.unsure2.mean())
    return own_law(views, named, config.noise, wrong2)


def check(views: Sequence[View], least: int) -> None:
    """Refuse sessions that cannot carry a diagnosis; `least` views do."""
    if not views:
        raise RefusedError(
            "0 views are too few to diagnose", where="session", todo=f"record at least {least} still views from different poses"
        )
    cameras = {v.camera for v in views}
    if len(cameras) > 1:
        msg = f"views of {len(cameras)} different cameras"
        raise RefusedError(msg, where="session", todo="diagnose one camera at a time")
    if all(v.robot is None for v in views):
        raise RefusedError("no view has a robot pose", where="session", todo="record /tf and /tf_static with the images")


def check_enough(views: Sequence[View], along_ray: Finding | None, least: int) -> None:
    """Refuse few views that do not even show distance along the ray."""
    if len(views) < least and along_ray is None:
        msg = f"{len(views)} views are too few to diagnose"
        raise RefusedError(msg, where="session", todo=f"record at least {least} still views from different poses")


def dealt(chain: Chain, limits: SolveLimits) -> Split:
    """One of every `held_out` views of each station is held out; with fewer than `views`, nothing is fitted and all are judged."""
    if len(chain.station) < limits.views:
        return Split((), tuple(range(len(chain.station))))
    fold = deal(chain.station.tolist(), limits.held_out)
    first, held_out, *others = (tuple(np.flatnonzero(fold == k).tolist()) for k in range(limits.held_out))
    return Split(tuple(np.flatnonzero(fold != 1).tolist()), held_out, (first, *others))
