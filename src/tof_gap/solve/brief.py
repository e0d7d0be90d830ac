# SPDX-License-Identifier: Apache-2.0
"""Motion in brief frames, which blur less: pixels near depth edges and at brightness edges are evidence too."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from tof_gap.seen.motion import moving
from tof_gap.solve.joint import solve
from tof_gap.solve.start import Start, observe
from tof_sensor.effects.motion import Motion

if TYPE_CHECKING:
    from tof_gap.config import GapConfig
    from tof_gap.solve.solution import Joint
    from tof_scene.raycast import Raycaster


def solve_moving(begun: Start, caster: Raycaster, config: GapConfig, left_out: frozenset[str] = frozenset()) -> tuple[Joint, GapConfig]:
    """The joint solution of a session, and the settings that it and all later steps use.

    In a moving session, pixels that the longest exposure may blur are left out, at brightness edges too. Frames of some tens of
    milliseconds have errors of millimetres just there, and small ones elsewhere. If the other pixels show no `motion`, the session is
    solved again as one of brief frames; that solution counts if it has `motion`. The first solution shows motion in longer exposures.
    """
    joint = solve(begun, caster, config, left_out)
    if Motion.NAME in left_out or not moving(joint.views) or _has_motion(joint):
        return joint, config
    blur = replace(config.evidence.blur, exposure_s=config.evidence.blur.brief_s, creases=False)
    brief = replace(config, evidence=replace(config.evidence, blur=blur))
    evidence = observe(begun.views, caster, begun.chain, brief, footprints=False)
    again = solve(Start(begun.views, begun.chain, evidence), caster, brief, left_out)
    return (again, brief) if _has_motion(again) else (joint, config)


def _has_motion(joint: Joint) -> bool:
    return any(joint.design.candidates[m].name == Motion.NAME for m in joint.selection.chosen.members)
