# SPDX-License-Identifier: Apache-2.0
"""Views that contradict the robot: their depth fits the CAD only where the arm cannot have been."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tof_gap.seen.world import taken_out
from tof_gap.solve.brief import solve_moving
from tof_gap.solve.judge import Selector
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
    """The joint solution of the views that agree with the robot, the settings that it and all that follows use, its views, and the stray ones.

    A stray view takes its station's base with it, and effects are fitted to its errors. Its pixels are taken out, and the session is
    solved again; the view stays in its place, without evidence.
    """
    joint, used = solve_moving(begun, caster, config, left_out)
    if joint.chain.root is not None:  # Poses with a covariance of their own owe nothing to the arm.
        return joint, used, begun.views, ()
    judge = Selector(joint.design, config.select)
    stray = stray_views(judge.arms(joint.selection.chosen) / judge.arms_sd, config.solve.stray)
    if not stray.any():
        return joint, used, begun.views, ()
    del joint, judge  # Images of all views are most of what a session needs in memory.
    views = without_pixels(begun.views, stray)
    again = Start(views, begun.chain, observe(views, caster, begun.chain, config, footprints=False))
    joint, used = solve_moving(again, caster, config, left_out)
    return joint, used, views, tuple(int(v) for v in np.flatnonzero(stray))


def stray_views(arms: Float, limits: StrayLimits) -> Mask:
    """(V,) views whose arm error is too large; none where many are, as those have a cause in common.

    arms (V, 6): arm errors in standard deviations of the robot's prior.
    """
    stray = np.sqrt((arms**2).mean(axis=1)) > limits.sigma
    return stray if stray.sum() <= limits.share * len(arms) else np.zeros(len(arms), bool)


def without_pixels(views: Sequence[View], which: Mask) -> list[View]:
    """The views, those of `which` (V,) without depth."""
    return [taken_out(v, v.valid) if out else v for v, out in zip(views, which, strict=True)]
