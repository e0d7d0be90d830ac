# SPDX-License-Identifier: Apache-2.0
"""The diagnosis of one session: where it differs from its simulation, which effect does it, how far it shrinks."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from tof_core.errors import RefusedError
from tof_gap import missing, scatter
from tof_gap.candidates import HAND_EYE, not_testable
from tof_gap.causes import Named, named, nameless_share, shares, without_pixels
from tof_gap.figures import figures
from tof_gap.flexible import explainable
from tof_gap.joint import at_solution, delayed, solution, solve, start
from tof_gap.judge import Selector, deal
from tof_gap.radial import gate
from tof_gap.unexplained import Unexplained, look, misfit
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
    from tof_gap.evidence import ViewEvidence
    from tof_gap.joint import Joint
    from tof_gap.kinds import Finding
    from tof_gap.shrink import Shrink
    from tof_scene.raycast import Raycaster

MIN_VIEWS = 4


@dataclass(frozen=True, slots=True, eq=False)
class Cause:
    """One effect of the verdict with what it does on held-out views."""

    named: Named
    alone: Shrink
    left_out: float | None


@dataclass(frozen=True, slots=True, eq=False)
class Diagnosis:
    """All that the report says; arrays are per view in bag order.

    residual: (H, W) metres measured minus rendered at the final joint poses, before any effect;
    floor2: (H, W) m^2; shares: metres per named effect;
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
    say("what scatter, loss and edges say")
    final, evidence = at_solution(joint, begun.views, caster, config)
    judge = Selector(joint.design, config.select)
    fit_views, held = split(joint.chain)
    causes = named(joint, fit_views, judge, rng)
    maps = shares(causes, evidence, final, caster)
    unnamed = [nameless_share(joint, v) for v in evidence]
    smooth = maps | shares(without_pixels(causes), evidence, final, caster)
    found = (along_ray,) if few and along_ray is not None else _findings(evidence, {**smooth, "": unnamed}, config, along_ray)
    findings = tuple(f for f in found if f.name not in left_out)
    nameless = tuple(f for f in found if f.name in left_out)
    say("how far the gap shrinks on held-out views")
    told = figures(evidence, joint, maps, findings, (fit_views, held), rng)
    if along_ray is not None and along_ray.share is not None:
        told = replace(told, residual=[r + share for r, share in zip(told.residual, along_ray.share, strict=True)])
    gap = told.shrink(list(told.maps))
    if findings and not told.maps:
        gap = replace(gap, shrink=None, ci95=None)  # Scatter and loss alone: nothing is there to be taken off.
    left = told.left()
    scattered = [f + s + told.unsure2 for f, s in zip(told.floors, _scatter2(findings, evidence), strict=True)]
    unexplained = look(
        evidence,
        left,
        told.floors,
        gap,
        caster.scene,
        at_solution=joint.views,
        gross_named=any(f.name == PhaseWrap.NAME for f in findings),
        alike_m=told.alike_m,
        nameless=nameless,
        depends_on=joint.selection.unknown,
        crowd=joint.selection.crowd,
        misfit=misfit(evidence, told.residual, left, scattered),
        arms_alike=0.0 if Motion.NAME in maps else judge.arms_alike(joint.selection.chosen),
    )
    judged = tuple(Cause(c, told.shrink([c.name]), told.shrink([m for m in told.maps if m != c.name]).shrink) for c in causes)
    share = explainable(evidence, left, fit_views, held, gap)
    verdict = sorted({*(c.verdict for c in causes), *(f.name for f in findings)})
    if unexplained.structured:
        verdict.append("unknown")
    return Diagnosis(
        tuple(sorted(verdict)) or ("none",),
        judged,
        findings,
        gap,
        share,
        unexplained,
        {n: f"{len(views)} views are too few" for n in VOCABULARY if n != RadialDepth.NAME} if few else _untested(joint, maps),
        evidence,
        tuple(told.residual),
        tuple(told.floors),
        told.maps,
        final,
        _cameras(joint, final),
        joint,
        fit_views,
        held,
    )


def _cameras(joint: Joint, final: Chain) -> Float:
    """(V, 4, 4) T_cell_camera with hand-eye and lateness as the solution has them."""
    there = delayed(replace(final, hand_eye=joint.hand_eye), joint.views, solution(joint)[1])
    return np.stack([there.pose(v) for v in range(len(there.station))])


def _untested(joint: Joint, maps: Mapping[str, Sequence[Float]]) -> dict[str, str]:
    """Effects that this session cannot test, with the reason."""
    beside_motion = {
        FlyingPixels.NAME: "motion mixes edges by itself: record at rest",
        HAND_EYE: "motion shifts what poses are known by: record at rest",
    }
    return not_testable(joint.views) | (beside_motion if Motion.NAME in maps else {})


def _findings(
    views: Sequence[ViewEvidence], maps: Mapping[str, Sequence[Float]], config: GapConfig, along_ray: Finding | None
) -> tuple[Finding, ...]:
    """What speaks otherwise than by smooth bias, once that is taken off."""
    zero = np.zeros(views[0].residual.shape)
    biased = [np.sum([zero, *(np.nan_to_num(m[v]) for m in maps.values())], axis=0) for v in range(len(views))]
    left = [replace(v, residual=v.residual - b) for v, b in zip(views, biased, strict=True)]
    return (
        *([] if along_ray is None else [along_ray]),
        *scatter.findings(left, config.scatter),
        *missing.findings(left, config.missing, smeared=Motion.NAME in maps),
    )


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
