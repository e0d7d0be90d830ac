# SPDX-License-Identifier: Apache-2.0
"""The joint solution: poses and named effects together, relinearised until they agree."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from tof_core.cores import in_threads
from tof_core.memory import give_back
from tof_gap.seen.evidence.edges import smear
from tof_gap.seen.evidence.motion import moving
from tof_gap.seen.evidence.residual import gather, without_geometry
from tof_gap.seen.missing.mixed import mixing
from tof_gap.solve.absent import bounds
from tof_gap.solve.choose.select import narrowed, select
from tof_gap.solve.choose.shapes import refined
from tof_gap.solve.hypotheses.candidates import candidates
from tof_gap.solve.hypotheses.columns import build, stored
from tof_gap.solve.hypotheses.crosstalk import crosstalk
from tof_gap.solve.hypotheses.free import curves
from tof_gap.solve.hypotheses.ghost import ghosts
from tof_gap.solve.hypotheses.region import regions
from tof_gap.solve.settle import followed, settled
from tof_gap.solve.solution import Joint, lens_of, solution
from tof_gap.solve.start import check_fit, farthest, observe
from tof_scene.render import render
from tof_sensor.effects.amplitude_bias import AmplitudeBias
from tof_sensor.effects.motion import Motion
from tof_sensor.effects.range_offset import RangeOffset
from tof_sensor.effects.time_sync import TimeSync
from tof_sensor.geometry import pose_columns

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_align.chain import Chain
    from tof_core.camera import Camera
    from tof_core.capture import View
    from tof_gap.config import GapConfig
    from tof_gap.seen.evidence.view import ViewEvidence
    from tof_gap.solve.hypotheses.columns import ColumnStore
    from tof_gap.solve.start import Start
    from tof_scene.raycast import Raycaster
    from tof_sensor.effect import Effect

SET_APART = {TimeSync.NAME: Motion.NAME, RangeOffset.NAME: AmplitudeBias.NAME}
"""Effects that may be set apart from the solution of another (`lateness`, `offset`), by name."""


def solve(begun: Start, caster: Raycaster, config: GapConfig, left_out: frozenset[str] = frozenset()) -> Joint:
    """Poses and effects at once, from the poses of `start`; relinearised while the cameras move.

    The first round brings the cameras near, with only those effects whose bias depends on the pixel alone; if they moved far, those
    chosen are fitted once more. In a moving session it takes all effects, since one that stands in for motion would move the cameras away.
    """
    give_back()
    views, chain, evidence = begun.views, begun.chain, begun.hand_over()
    limits = config.solve.joint
    check_fit(evidence, config.solve.start)
    wider_px = edges_wider_px(evidence, caster, chain, config)
    if wider_px:
        del evidence  # Images of all views are most of a session's memory: those of one round go before the next.
        evidence = observe(views, caster, chain, config, footprints=False, wider_px=wider_px)
    quick = not moving(evidence)
    joint, store = _linearised(evidence, caster, chain, config, left_out, quick=quick)
    del evidence
    for number in range(limits.rounds - 1):
        (after, late_s), lens = solution(joint), lens_of(joint)
        first, members = joint.chain, [candidate for candidate, _ in joint.members()]
        del joint, store
        if quick and number == 0 and farthest(first, after, limits) > 1.0:
            # One more step of the chosen effects, so that all hypotheses are computed near the solution, once and not twice.
            near = as_recorded(observe(views, caster, after, config, footprints=False, wider_px=wider_px, lens=lens), late_s, lens)
            after = followed(members, near, after, config)
            del near
        seen = observe(views, caster, after, config, footprints=False, concavity=True, wider_px=wider_px, lens=lens)
        joint, store = _linearised(as_recorded(seen, late_s, lens), caster, after, config, left_out)
        joint = replace(joint, late_s=late_s)
        del seen
        if farthest(after, solution(joint)[0], limits) <= 1.0 and _alike(lens, lens_of(joint), views[0].camera, limits.lens_px):
            break
    if not joint.design.candidates:
        return replace(joint, views=tuple(map(without_geometry, joint.views)))
    give_back()
    # Formulas first, each in its best shape; then errors without a name compete.
    finer = refined(store, joint.design, joint.selection, joint.chain, config)
    light = [*crosstalk(joint.views, config.stated_mhz), *ghosts(joint.views, config.stated_mhz)]
    free = [*curves(joint.views, joint.asked), *light, *regions(joint.views, store.folds)]
    design = build(store, [*joint.design.candidates, *finer, *free], joint.chain, config.hand_sd, config.lens_sd)
    del store  # Columns of all hypotheses take half a gigabyte in a long session; a selection needs only their products.
    joint = replace(joint, design=design, selection=select(design, config.select, joint.selection.chosen.members))
    final = replace(settled(joint, config), bounds=bounds(joint, config))
    return replace(final, views=tuple(map(without_geometry, final.views)))


def without(joint: Joint, name: str, config: GapConfig) -> Joint:
    """The same solution without the effect `name`, all others fitted again; one that was set apart from another goes with that (`SET_APART`)."""
    members = joint.selection.chosen.members
    own = any(joint.design.candidates[m].name == name for m in members)
    gone = name if own else SET_APART[name]
    left = narrowed(joint.design, config.select, joint.selection, joint.design.without(members, gone))
    return replace(joint, selection=replace(left, fullest=tuple(joint.design.without(left.fullest, gone))))


def with_small(joint: Joint, config: GapConfig) -> Joint:
    """The same solution with the small effects and the small terms of effects that the selection dropped, all fitted again."""
    return replace(joint, selection=narrowed(joint.design, config.select, joint.selection, joint.selection.fullest))


def edges_wider_px(evidence: Sequence[ViewEvidence], caster: Raycaster, chain: Chain, config: GapConfig) -> int:
    """Pixels by which the edges of still views are wider than usual: where they show mixed pixels, whose depth lies on neither surface."""
    if all(smear(v.frame, v.limits.blur) > 0 for v in evidence):
        return 0
    return config.solve.joint.mixed_px if _mixes([v.view for v in evidence], caster, chain, config) else 0


def _mixes(views: Sequence[View], caster: Raycaster, chain: Chain, config: GapConfig) -> bool:
    some = range(0, len(views), config.solve.joint.mixed_every)
    renderings = in_threads(lambda i: render(caster, views[i].camera, chain.pose(i)), some)
    return mixing(gather([views[i] for i in some], renderings, caster, config.evidence), config.missing) is not None


def _alike(one: Effect | None, other: Effect | None, stated: Camera, lens_px: float) -> bool:
    """Whether two lenses have the same rays to within `lens_px` pixels."""
    rays = [(stated if lens is None else lens.camera(stated)).rays() for lens in (one, other)]
    return one is other or bool(np.abs(rays[0] - rays[1]).max() < lens_px * stated.pixel_angle)


def as_recorded(evidence: Sequence[ViewEvidence], late_s: float, lens: Effect | None) -> tuple[ViewEvidence, ...]:
    """Evidence at the cameras' true times and with their true lens, but with the residual of the stated stamps and lens (first order)."""
    out = tuple(evidence)
    if late_s != 0.0:
        out = tuple(replace(v, residual=v.residual + late_s * (pose_columns(v.frame) @ v.frame.context.twist)) for v in out)
    return out if lens is None else tuple(replace(v, residual=v.residual + lens.bias(v.frame)) for v in out)


def _linearised(
    evidence: tuple[ViewEvidence, ...],
    caster: Raycaster,
    chain: Chain,
    config: GapConfig,
    left_out: frozenset[str],
    *,
    quick: bool = False,
) -> tuple[Joint, ColumnStore]:
    """A selection among all hypotheses, linearised at one chain, and its columns."""
    store = stored(evidence, chain, config.select.folds)
    tested = candidates(evidence, caster.scene, config.noise, left_out, quick=quick, stated_mhz=config.stated_mhz)
    design = build(store, tested, chain, config.hand_sd, config.lens_sd)
    asked = frozenset(c.name for c in design.candidates)
    return Joint(chain, evidence, design, select(design, config.select), asked=asked), store
