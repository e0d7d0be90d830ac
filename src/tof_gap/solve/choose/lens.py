# SPDX-License-Identifier: Apache-2.0
"""A wrong lens beside the lens that every hypothesis contains within its stated calibration."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tof_gap.solve.choose.worth import rescored
from tof_sensor.effects.intrinsics import Intrinsics

if TYPE_CHECKING:
    from tof_gap.solve.choose.judge import Hypothesis, Selector


def with_lens(judge: Selector, current: Hypothesis) -> Hypothesis:
    """The hypothesis with a wrong lens, in the form beside which least is left, where it has one or its calibrated lens contradicts the calibration.

    The calibrated lens absorbs a wrong one, against a prior that weighs little beside thousands of pixels: freeing it hardly explains more.
    The search adds one form beside the calibrated lens of the other, and both together describe either form nearly as well: the form is
    chosen here, with both lenses in the same.
    """
    candidates = judge.design.candidates
    place = next((i for i, m in enumerate(current.members) if candidates[m].name == Intrinsics.NAME), None)
    if place is None and not judge.needed_by_calibration(Intrinsics.NAME, current):
        return current
    before, after = (current.members, ()) if place is None else (current.members[:place], current.members[place + 1 :])
    forms = [i for i, c in enumerate(candidates) if c.name == Intrinsics.NAME and not judge.repeats(i, [*before, *after])]
    trials = [judge.score([*before, i, *after], current.inflate) for i in forms]
    return rescored(judge, min(trials, key=lambda trial: trial.score).members) if trials else current
