# SPDX-License-Identifier: Apache-2.0
"""Motion in brief frames, which blur less: pixels near depth edges and at brightness edges are evidence too."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from tof_gap.seen.evidence.motion import moving
from tof_gap.solve.choose.worth import rescored
from tof_gap.solve.hypotheses.candidates import candidates
from tof_gap.solve.joint import as_recorded, edges_wider_px, solve
from tof_gap.solve.settle import judge_of
from tof_gap.solve.solution import lens_of, solution
from tof_gap.solve.start import Start, observe
from tof_sensor.effects.motion import Motion
from tof_sensor.registry import VOCABULARY

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.capture import View
    from tof_gap.config import GapConfig
    from tof_gap.solve.solution import Joint
    from tof_scene.raycast import Raycaster


def solve_moving(begun: Start, caster: Raycaster, config: GapConfig, left_out: frozenset[str] = frozenset()) -> tuple[Joint, GapConfig]:
    """The joint solution of a session, and the settings that it and all later steps use.

    In a moving session, pixels that the longest exposure may blur are left out, at brightness edges too. Frames of some tens of
    milliseconds have errors of millimetres just there, and small ones elsewhere. If the other pixels show no `motion`, and those of brief
    frames do beside the effects found, the session is solved again as one of brief frames; that solution counts if it has `motion`. The
    first solution shows motion in longer exposures.
    """
    joint = solve(begun, caster, config, left_out)
    if Motion.NAME in left_out or not moving(joint.views) or _has_motion(joint):
        return joint, config
    blur = replace(config.evidence.blur, exposure_s=config.evidence.blur.brief_s, creases=False)
    brief = replace(config, evidence=replace(config.evidence, blur=blur))
    if not shows_motion(joint, begun.views, caster, brief):
        return joint, config
    evidence = observe(begun.views, caster, begun.chain, brief, footprints=False)
    again = solve(Start(begun.views, begun.chain, evidence), caster, brief, left_out)
    return (again, brief) if _has_motion(again) else (joint, config)


def shows_motion(joint: Joint, views: Sequence[View], caster: Raycaster, config: GapConfig) -> bool:
    """Whether some form of `motion`, at the poses found, explains more beside the effects found, or as much in the place of one of them.

    A test of all effects takes three times as long.
    """
    (chain, late_s), lens = solution(joint), lens_of(joint)
    look = partial(observe, views, caster, chain, config, footprints=False, lens=lens)
    seen = look()
    wider_px = edges_wider_px(seen, caster, chain, config)
    seen = as_recorded(look(wider_px=wider_px) if wider_px else seen, late_s, lens)
    found = [candidate for candidate, _ in joint.members()]
    forms = candidates(seen, caster.scene, config.noise, frozenset(VOCABULARY) - {Motion.NAME}, stated_mhz=config.stated_mhz)
    if not forms:
        return False
    judge = judge_of([*found, *forms], seen, chain, config)
    now = rescored(judge, range(len(found)))

    def best(rest: Sequence[int]) -> float:
        beside = judge.beside(rest, len(rest), now.inflate)
        return min(beside(len(found) + i).score for i in range(len(forms)))

    instead = [best([m for m in now.members if m != member]) for member in now.members]
    return best(now.members) < now.score - judge.gain(len(found)) or any(s < now.score + config.select.tie_gain for s in instead)


def _has_motion(joint: Joint) -> bool:
    return any(candidate.name == Motion.NAME for candidate, _ in joint.members())
