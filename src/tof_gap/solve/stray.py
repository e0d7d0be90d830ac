# SPDX-License-Identifier: Apache-2.0
"""Stray views, which contradict the robot: their depth fits the CAD only at a pose that the arm cannot have had."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tof_gap.seen.world import taken_out
from tof_gap.solve.brief import solve_moving
from tof_gap.solve.choose.judge import Selector
from tof_gap.solve.start import Start, observe

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Float, Mask
    from tof_core.capture import View
    from tof_gap.config import GapConfig
    from tof_gap.limits.solve import StrayLimits
    from tof_gap.solve.solution import Joint
    from tof_scene.raycast import Raycaster


def solve_agreeing(
    begun: Start, caster: Raycaster, config: GapConfig, left_out: frozenset[str] = frozenset()
) -> tuple[Joint, GapConfig, Sequence[View], tuple[int, ...]]:
    """The joint solution of the views that agree with the robot, its settings, its views, and the indices of the stray views.

    A stray view shifts its station's base, and effects are fitted to its errors. Therefore its pixels are removed and the session is
    solved again; the view stays in its place, without evidence. All later steps use the same settings and views.
    """
    joint, used = solve_moving(begun, caster, config, left_out)
    if joint.chain.root is not None:  # Poses with a covariance of their own do not depend on the arm.
        return joint, used, begun.views, ()
    judge = Selector(joint.design, config.select)
    stray = stray_views(judge.arms(joint.selection.chosen) / judge.arms_sd, config.solve.stray)
    if not stray.any():
        return joint, used, begun.views, ()
    del joint, judge  # Images of all views are most of a session's memory.
    views = without_pixels(begun.views, stray)
    again = Start(views, begun.chain, observe(views, caster, begun.chain, config, footprints=False))
    joint, used = solve_moving(again, caster, config, left_out)
    return joint, used, views, tuple(int(v) for v in np.flatnonzero(stray))


def stray_views(arms: Float, limits: StrayLimits) -> Mask:
    """(V,) views whose arm error is too large; none if there are many, since these have a common cause.

    arms (V, 6): arm errors in standard deviations of the robot's prior.
    """
    stray = arm_error(arms) > limits.sigma
    return stray if stray.sum() <= limits.share * len(arms) else np.zeros(len(arms), bool)


def arm_error(arms: Float) -> Float:
    """(V,) arm errors (V, 6), in standard deviations of the robot's prior: RMS over their six components."""
    return np.asarray(np.sqrt((arms**2).mean(axis=1)))


def without_pixels(views: Sequence[View], which: Mask) -> list[View]:
    """The views, those of `which` (V,) without depth."""
    return [taken_out(v, v.valid) if out else v for v, out in zip(views, which, strict=True)]
