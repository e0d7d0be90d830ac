# SPDX-License-Identifier: Apache-2.0
"""A wrong lens beside the lens that every hypothesis contains within its stated calibration."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tof_gap.solve.choose.worth import rescored
from tof_sensor.effects.intrinsics import Intrinsics

if TYPE_CHECKING:
    from tof_gap.solve.choose.judge import Hypothesis, Selector


def with_lens(judge: Selector, current: Hypothesis) -> Hypothesis:
    """The hypothesis with a wrong lens where the lens that every hypothesis contains contradicts its calibration.

    That lens absorbs a wrong one, against a prior that weighs little beside thousands of pixels: freeing it hardly explains more.
    """
    candidates = judge.design.candidates
    if not judge.needed_by_calibration(Intrinsics.NAME, current):
        return current
    forms = [i for i, c in enumerate(candidates) if c.name == Intrinsics.NAME and not judge.repeats(i, current.members)]
    trials = [judge.score([*current.members, i], current.inflate) for i in forms]
    return rescored(judge, min(trials, key=lambda trial: trial.score).members) if trials else current


def in_form_of_lens(judge: Selector, current: Hypothesis) -> Hypothesis:
    """The hypothesis whose wrong lens has the form that wins most held-out chi-square, with the lens within its calibration in the same form.

    The search adds one form beside the calibrated lens of the other, and both together describe either form nearly as well.
    """
    candidates = judge.design.candidates
    place = next((i for i, m in enumerate(current.members) if candidates[m].name == Intrinsics.NAME), None)
    if place is None:
        return current
    forms = [i for i, c in enumerate(candidates) if c.name == Intrinsics.NAME]
    trials = [judge.score([*current.members[:place], i, *current.members[place + 1 :]], current.inflate) for i in forms]
    return rescored(judge, min(trials, key=lambda trial: trial.score).members)
