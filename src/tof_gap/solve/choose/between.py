# SPDX-License-Identifier: Apache-2.0
"""Whether an effect shows within views before a board, or only between them, where a view is one sample."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.special import fdtrc

from tof_gap.solve.choose.worth import rescored
from tof_sensor.effects.wiggling import Wiggling

if TYPE_CHECKING:
    from tof_gap.solve.choose.judge import Hypothesis, Selector


def shown(judge: Selector, current: Hypothesis, place: int) -> bool:
    """Whether the views determine the member at `place`; always where poses are fitted to depth.

    One board spans little range, and light of its surroundings shifts a view as a whole: then all of its pixels are one sample. With
    every view's distance free, what an effect still explains shows within views, and must be what every effect must win. The rest shows
    between views. It is compared with the spread of views that all members leave (F-test), for each form of the effect that was tried.
    """
    member, system, apart = current.members[place], judge.design.system, judge.apart
    if apart is None or judge.is_free(member) or judge.frees_hand([member]):
        return True
    rest = [m for i, m in enumerate(current.members) if i != place]
    (held0, held1), (free0, free1) = (
        [s.fit(judge.columns(members), inflate=current.inflate).energy for members in (rest, current.members)] for s in (system, apart)
    )
    if free0 - free1 >= judge.gain(member):
        return True
    own, every = (sum(_unknowns(judge, m) for m in members) for members in ([member], current.members))
    views = len(system.pixels) - every
    if views < 1:
        return False
    between0, between1 = held0 - free0, max(held1 - free1, 1e-12)
    ratio = max(between0 - between1, 0.0) / own / (between1 / views)
    return bool(fdtrc(own, views, ratio) * judge.forms(member) < judge.config.chance)


def with_suspect(judge: Selector, current: Hypothesis) -> tuple[Hypothesis, tuple[int, ...]]:
    """The hypothesis with the longest wave over range, where views before a board do not determine one, and that wave as suspected.

    It joins if held-out views gain by it what every effect must win: then it predicts other views better. Such views do not determine a
    period either; the longest one, hardly a bend over the session's range, has no shape to be fitted by chance.
    """
    candidates = judge.design.candidates
    periods = {i: c.effect.period_m for i, c in enumerate(candidates) if isinstance(c.effect, Wiggling) and not c.effect.knots}
    if judge.apart is None or not periods or any(candidates[m].name == Wiggling.NAME for m in current.members):
        return current, ()
    longest = max(periods, key=periods.__getitem__)
    trial = judge.score([*current.members, longest], current.inflate)
    if (current.held_out - trial.held_out).sum() < judge.gain(longest) or not judge.plausible(trial):
        return current, ()
    return rescored(judge, trial.members), (longest,)


def _unknowns(judge: Selector, member: int) -> int:
    """Coefficients of a member whose columns are not 0 everywhere, and one for its shape if it has several forms."""
    normal, group = judge.design.system.normal, judge.design.groups[member]
    at = normal.shared - judge.design.system.columns + group
    return int(np.count_nonzero(normal.gram[:, at, at].any(axis=0))) + (judge.forms(member) > 1)
