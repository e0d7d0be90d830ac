# SPDX-License-Identifier: Apache-2.0
"""Selection in several sessions of one scene together: effects that one session shows beside those that all are fitted with."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from tof_gap.solve.choose.select import weak, won_steadily
from tof_gap.solve.choose.worth import rescored

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from tof_gap.solve.choose.judge import Hypothesis, Selector


@dataclass(frozen=True, slots=True, eq=False)
class Jointly:
    """One set of candidates in every session, each with coefficients of its own."""

    sides: tuple[Hypothesis, ...]

    @property
    def members(self) -> tuple[int, ...]:
        """The candidates."""
        return self.sides[0].members

    @property
    def score(self) -> float:
        """Held-out chi-square of all sessions; the number of forms that were tried is paid for once."""
        return sum(float(h.held_out.sum()) for h in self.sides) + max(h.price for h in self.sides)


def added(judges: Sequence[Selector], begun: Sequence[int]) -> tuple[int, ...]:
    """The candidates that a session shows beside the members `begun`, which stay.

    They are added one by one, the one first by which the held-out chi-square of all sessions together shrinks most, and exchanged while
    another does better. In the end, each must be an effect in one of the sessions by what a diagnosis asks of its members.

    Args:
        judges: of each session, over the same candidates.
        begun: members of the hypothesis that the selection starts from.
    """
    current, config = _rescored(judges, begun), judges[0].config
    while len({judges[0].design.candidates[m].name for m in current.members}) < config.most:
        better = _best_addition(judges, current)
        if better is None:
            break
        current = _exchanged(judges, better, len(begun))
    return _strong(judges, current, len(begun)).members[len(begun) :]


def _rescored(judges: Sequence[Selector], members: Sequence[int]) -> Jointly:
    return Jointly(tuple(rescored(judge, members) for judge in judges))


def _beside(judges: Sequence[Selector], current: Jointly, place: int) -> Callable[[int], Jointly]:
    """The hypothesis with a candidate at `place`, instead of the member there if there is one."""
    rest = [m for i, m in enumerate(current.members) if i != place]
    scored = [judge.beside(rest, place, side.inflate) for judge, side in zip(judges, current.sides, strict=True)]
    return lambda i: Jointly(tuple(of_one(i) for of_one in scored))


def _best_addition(judges: Sequence[Selector], current: Jointly) -> Jointly | None:
    trial_of, best = _beside(judges, current, len(current.members)), None
    for i in _others(judges[0], current.members):
        trial = trial_of(i)
        wins = current.score - trial.score >= judges[0].gain(i) and (best is None or trial.score < best.score)
        if wins and _believable(judges, current, trial):
            best = trial
    return None if best is None else _rescored(judges, best.members)


def _believable(judges: Sequence[Selector], before: Jointly, after: Jointly) -> bool:
    """Whether in the session that wins most, more than one view wins, and the coefficients are possible. The others may be without it."""
    won = [b.score - a.score for b, a in zip(before.sides, after.sides, strict=True)]
    most = max(range(len(won)), key=won.__getitem__)
    judge, one, other = judges[most], before.sides[most], after.sides[most]
    return won_steadily(one, other, judge.config.gain, judge.config) and judge.plausible(other)


def _exchanged(judges: Sequence[Selector], current: Jointly, kept: int) -> Jointly:
    """Replace members after the first `kept` one at a time while another candidate does better in their place."""
    improved = True
    while improved:
        improved = False
        for place in range(kept, len(current.members)):
            without = _rescored(judges, [m for i, m in enumerate(current.members) if i != place])
            trial_of = _beside(judges, current, place)
            for i in _others(judges[0], without.members):
                trial = trial_of(i)
                if trial.score < current.score - judges[0].config.exchange and _believable(judges, without, trial):
                    current, improved = trial, True
    return _rescored(judges, current.members)


def _others(judge: Selector, members: Sequence[int]) -> Iterator[int]:
    """Candidates that a hypothesis with these members may contain besides."""
    return (i for i in range(len(judge.design.candidates)) if not judge.repeats(i, members))


def _strong(judges: Sequence[Selector], current: Jointly, kept: int) -> Jointly:
    """The hypothesis without those members after the first `kept` that are weak in every session."""
    while len(current.members) > kept:
        least = [weak(judge, side) for judge, side in zip(judges, current.sides, strict=True)]
        everywhere = set.intersection(*({place for _, place in of_one} for of_one in least)) - set(range(kept))
        if not everywhere:
            break
        size = {place: max(v for of_one in least for v, i in of_one if i == place) for place in everywhere}
        drop = min(everywhere, key=size.__getitem__)
        current = _rescored(judges, [m for i, m in enumerate(current.members) if i != drop])
    return current
