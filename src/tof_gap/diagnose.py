# SPDX-License-Identifier: Apache-2.0
"""The diagnosis of one session: where it differs from its simulation, which effect does it, how far it shrinks."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from tof_align.folds import deal
from tof_core.errors import RefusedError
from tof_gap.seen.noise import own_law
from tof_gap.solve.candidates import HAND_EYE, not_testable
from tof_gap.solve.joint import delayed, solution, solve, start, without
from tof_gap.solve.judge import Selector
from tof_gap.solve.radial import gate
from tof_gap.tell.account import account
from tof_gap.tell.explainable import explainable
from tof_gap.tell.unexplained import Unexplained, look, misfit
from tof_sensor.effect import Evidence
from tof_sensor.effects.flying_pixels import FlyingPixels
from tof_sensor.effects.motion import Motion
from tof_sensor.effects.phase_wrap import PhaseWrap
from tof_sensor.effects.radial_depth import RadialDepth
from tof_sensor.registry import VOCABULARY

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from tof_align.chain import Chain
    from tof_align.config import AlignConfig
    from tof_core.arrays import Float
    from tof_core.capture import View
    from tof_gap.config import GapConfig
    from tof_gap.seen.finding import Finding
    from tof_gap.seen.residual import ViewEvidence
    from tof_gap.solve.joint import Joint
    from tof_gap.tell.account import Cause
    from tof_gap.tell.shrink import Shrink
    from tof_scene.raycast import Raycaster
    from tof_sensor.effects.noise import PhotonLaw

MIN_VIEWS = 4


@dataclass(frozen=True, slots=True, eq=False)
class Diagnosis:
    """All that the report says; arrays are per view in bag order.

    residual: (H, W) metres measured minus rendered at the final joint poses, before any effect;
    floor2: (H, W) m^2; shares: metres per named effect; law: of the scatter beside what was named of it, None where too little is seen;
    cameras: (V, 4, 4) T_cell_camera, X and all.
    """

    verdict: tuple[str, ...]
    causes: tuple[Cause, ...]
    findings: tuple[Finding, ...]
    gap: Shrink
    explainable: float | None
    unexplained: Unexplained
    not_testable: dict[str, str]
    evidence: tuple[ViewEvidence, ...]
    residual: tuple[Float, ...]
    floor2: tuple[Float, ...]
    shares: Mapping[str, Sequence[Float]]
    chain: Chain
    cameras: Float
    joint: Joint
    fit_views: tuple[int, ...]
    held_out_views: tuple[int, ...]
    config: GapConfig
    law: PhotonLaw | None


def diagnose(
    views: Sequence[View],
    caster: Raycaster,
    config: GapConfig,
    align: AlignConfig,
    left_out: frozenset[str] = frozenset(),
    say: Callable[[str], None] = lambda _: None,
    bends: Callable[[View], bool] = lambda _: False,
) -> Diagnosis:
    """Diagnose a session.

    Args:
        views: of one camera, in bag order, each with its robot pose and station.
        caster: the scene.
        config: when an effect is believed.
        align: the robot's priors.
        left_out: effects not to be considered (a test of `unknown`).
        say: told of each step.
        bends: whether wide planes of a view bend as distances taken for z do; poses of few views would bend with them.

    Raises:
        RefusedError: too few views, or a session that fits the scene nowhere. Fewer than `MIN_VIEWS` carry one answer alone: that
            depth is distance along the ray.
    """
    check(views)
    few = len(views) < MIN_VIEWS
    rng = np.random.default_rng(config.evidence.seed)
    say("depth or distance")
    if RadialDepth.NAME in left_out:
        begun, along_ray = start(views, caster, config, align), None
    else:
        begun, along_ray = gate(views, caster, config, align, bends)
    if few and along_ray is None:
        msg = f"{len(views)} views are too few to diagnose"
        raise RefusedError(msg, where="session", todo=f"record at least {MIN_VIEWS} still views from different poses")
    say("poses and effects together")
    joint = solve(begun, caster, config, frozenset(VOCABULARY) if few else left_out)
    say("what scatter, loss and edges say, and how far the gap shrinks on held-out views")
    fit_views, held = split(joint.chain)
    read = partial(account, split=(fit_views, held), rng=rng, along_ray=along_ray, alone=few, left_out=left_out)
    found = read(joint, begun.views, caster, config)
    while (name := found.worsens) is not None:
        joint = without(joint, name, config)
        found = read(joint, begun.views, caster, config)
    evidence, told, left = found.evidence, found.told, found.told.left()
    scattered = [f + s + told.unsure2 for f, s in zip(told.floors, _scatter2(found.findings, evidence), strict=True)]
    moved = any(c.named.name == Motion.NAME for c in found.causes)
    unexplained = look(
        evidence,
        left,
        told.floors,
        found.gap,
        caster.scene,
        at_solution=joint.views,
        gross_named=any(f.name == PhaseWrap.NAME for f in found.findings),
        alike_m=told.alike_m,
        nameless=found.nameless,
        depends_on=joint.selection.unknown,
        crowd=joint.selection.crowd,
        misfit=misfit(evidence, told.residual, left, scattered),
        arms_alike=0.0 if moved else Selector(joint.design, config.select).arms_alike(joint.selection.chosen),
    )
    verdict = sorted({*(c.named.verdict for c in found.causes), *(f.name for f in found.findings)})
    if unexplained.structured:
        verdict.append("unknown")
    return Diagnosis(
        tuple(sorted(verdict)) or ("none",),
        found.causes,
        found.findings,
        found.gap,
        explainable(evidence, left, fit_views, held, found.gap),
        unexplained,
        {n: f"{len(views)} views are too few" for n in VOCABULARY if n != RadialDepth.NAME} if few else _untested(joint, moved=moved),
        evidence,
        tuple(told.residual),
        tuple(told.floors),
        told.maps,
        found.chain,
        _cameras(joint, found.chain),
        joint,
        fit_views,
        held,
        config,
        own_law(evidence, [f.effect for f in found.findings], config.scatter.bins),
    )


def _cameras(joint: Joint, final: Chain) -> Float:
    """(V, 4, 4) T_cell_camera with hand-eye and lateness as the solution has them."""
    there = delayed(replace(final, hand_eye=joint.hand_eye), joint.views, solution(joint)[1])
    return np.stack([there.pose(v) for v in range(len(there.station))])


def _untested(joint: Joint, *, moved: bool) -> dict[str, str]:
    """Effects that this session cannot test, with the reason."""
    beside_motion = {
        FlyingPixels.NAME: "motion mixes edges by itself: record at rest",
        HAND_EYE: "motion shifts what poses are known by: record at rest",
    }
    return not_testable(joint.views) | (beside_motion if moved else {})


def _scatter2(findings: Sequence[Finding], views: Sequence[ViewEvidence]) -> Float:
    """(V, H, W) m^2 of scatter that was named: not white perhaps, but said."""
    named = [np.nan_to_num(f.share) ** 2 for f in findings if f.effect.EVIDENCE is Evidence.SCATTER and f.share is not None]
    return np.asarray(np.sum(named or [np.zeros((len(views), *views[0].residual.shape))], axis=0))


def check(views: Sequence[View]) -> None:
    """Refuse sessions that cannot carry a diagnosis."""
    if not views:
        raise RefusedError(
            "0 views are too few to diagnose", where="session", todo=f"record at least {MIN_VIEWS} still views from different poses"
        )
    cameras = {v.camera for v in views}
    if len(cameras) > 1:
        msg = f"views of {len(cameras)} different cameras"
        raise RefusedError(msg, where="session", todo="diagnose one camera at a time")
    if all(v.robot is None for v in views):
        raise RefusedError("no view has a robot pose", where="session", todo="record /tf and /tf_static with the images")


def split(chain: Chain) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """(fit, held out): every third view of each station is held out; of very few nothing is fitted, and all are judged."""
    if len(chain.station) < MIN_VIEWS:
        return (), tuple(range(len(chain.station)))
    fold = deal(chain.station.tolist(), 3)
    return tuple(np.flatnonzero(fold != 1).tolist()), tuple(np.flatnonzero(fold == 1).tolist())
