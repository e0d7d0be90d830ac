# SPDX-License-Identifier: Apache-2.0
"""From a joint solution to what the report needs: coefficients of the fit views, maps, and the views at the final poses."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from tof_gap.solve.causes import free_share, named, shares, without_pixels
from tof_gap.solve.judge import Selector
from tof_gap.solve.solution import delayed, solution
from tof_gap.solve.start import observe
from tof_gap.solved import Solved
from tof_sensor.effects.motion import Motion

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.capture import View
    from tof_gap.config import GapConfig
    from tof_gap.solve.solution import Joint
    from tof_gap.solved import Split
    from tof_scene.raycast import Raycaster


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
    after, late_s = solution(joint)
    # Hand-eye and lateness are effects: the figures are stated at poses without them. Mixed pixels need exact poses and footprints.
    final = replace(delayed(after, joint.views, -late_s), hand_eye=np.eye(4))
    with_effects = delayed(replace(final, hand_eye=joint.hand_eye), joint.views, late_s)
    evidence = observe(views, caster, final, config, concavity=True)
    causes = tuple(named(joint, split.fit, judge, rng))
    other_m = config.solve.joint.other_surface_mm * 1e-3
    maps = shares(causes, evidence, final, caster, other_m)
    smooth = maps | shares(without_pixels(causes), evidence, final, caster, other_m)
    moved = Motion.NAME in maps
    return Solved(
        chain=final,
        cameras=np.stack([with_effects.pose(v) for v in range(len(evidence))]),
        camera_covs=joint.design.system.camera_covs(joint.selection.fit),
        hand_eye=joint.hand_eye,
        evidence=evidence,
        linearised=joint.views,
        linearised_at=joint.chain,
        named=causes,
        maps=maps,
        tied=tuple(
            (joint.design.candidates[member].effect, joint.design.candidates[other].effect)
            for member, others in zip(joint.selection.chosen.members, joint.selection.ties, strict=True)
            for other in others
        ),
        bias=[
            np.sum([np.zeros(e.residual.shape), *(np.nan_to_num(m[v]) for m in smooth.values()), free_share(joint, e)], axis=0)
            for v, e in enumerate(evidence)
        ],
        depends_on=joint.selection.unknown,
        small_together=joint.selection.small_together,
        # Motion shifts what poses are known by: then arms that err alike say nothing of the mount.
        arms_alike=0.0 if moved else judge.arms_alike(joint.selection.chosen),
        split=split,
    )
