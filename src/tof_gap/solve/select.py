# SPDX-License-Identifier: Apache-2.0
"""Which effects: added one by one, each by what it explains on views it was not fitted to."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tof_gap.solve.free import Unknown
from tof_gap.solve.judge import Hypothesis, Selector
from tof_sensor.effects.motion import Motion

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_align.columns import ColumnFit
    from tof_core.arrays import Float
    from tof_gap.limits.solve import SelectLimits
    from tof_gap.solve.columns import Design


@dataclass(frozen=True, slots=True, eq=False)
class Selection:
    """The chosen hypothesis, the empty one, and for each member those that could stand in for it."""

    chosen: Hypothesis
    fit: ColumnFit
    empty: Hypothesis
    ties: tuple[tuple[int, ...], ...]
    visible: Float
    """(members,) metres RMS that each member explains of held-out views, left out of all."""
    left_out: Float
    """(members,) held-out chi-square lost without the member."""
    unknown: tuple[str, ...]
    """Observables on which something depends that no named effect explains, most first."""
    crowd: tuple[str, ...]
    """Effects that each explained a little beside two others: together they draw something else."""


def select(design: Design, config: SelectLimits) -> Selection:
    """Add, exchange and drop effects until nothing is won; then say which could be exchanged."""
    judge = Selector(design, config)
    current = judge.score((), judge.inflation(()))
    while len(current.members) < config.most:
        better = _best_addition(judge, current)
        if better is None:
            break
        current = _exchange(judge, better)
    current, crowd = _without_crowd(judge, _prune(judge, current))
    return _described(judge, current, crowd)


def narrowed(design: Design, config: SelectLimits, selection: Selection, members: Sequence[int]) -> Selection:
    """The selection with these of its members alone, fitted anew."""
    judge = Selector(design, config)
    return _described(judge, _rescored(judge, members), selection.crowd)


def _rescored(judge: Selector, members: Sequence[int]) -> Hypothesis:
    return judge.score(members, judge.inflation(members))


def _best_addition(judge: Selector, current: Hypothesis) -> Hypothesis | None:
    best: Hypothesis | None = None
    for i in range(len(judge.design.candidates)):
        if judge.repeats(i, current.members):
            continue
        trial = judge.score((*current.members, i), current.inflate)
        if current.score - trial.score < judge.gain(i) or not _steady(current, trial, judge.gain(i), judge.config):
            continue
        if (best is None or trial.score < best.score) and judge.plausible(trial):
            best = trial
    return None if best is None else _rescored(judge, best.members)


def _steady(before: Hypothesis, after: Hypothesis, gain: float, limits: SelectLimits) -> bool:
    """Whether the win is no single view's: without the best view, a share of it remains, or all that is asked."""
    won = before.held_out - after.held_out
    return bool(won.sum() - won.max() > min(limits.steady * won.sum(), gain) or len(won) < limits.steady_views)


def _exchange(judge: Selector, current: Hypothesis) -> Hypothesis:
    """Replace members one at a time while another candidate does better in their place."""
    improved = True
    while improved:
        improved = False
        for place in range(len(current.members)):
            rest = [m for i, m in enumerate(current.members) if i != place]
            for i in range(len(judge.design.candidates)):
                if i in current.members or judge.repeats(i, rest):
                    continue
                trial = judge.score([*rest[:place], i, *rest[place:]], current.inflate)
                if trial.score < current.score - judge.config.exchange and judge.plausible(trial):
                    current = trial
                    improved = True
    return _rescored(judge, current.members)


def _prune(judge: Selector, current: Hypothesis) -> Hypothesis:
    """Drop members whose absence costs little."""
    while current.members:
        lost, visible = _worth(judge, current)
        total = float((visible**2).sum())
        weak = [
            (v, i)
            for i, (gain, v) in enumerate(zip(lost, visible, strict=True))
            if gain < judge.gain(current.members[i])
            or v * v < judge.share(current.members[i]) * total
            or gain < judge.config.absorbed * _mendable(judge, current, i)
            or gain < _rough(judge, current, i, lost)
        ]
        if not weak:
            break
        drop = min(weak)[1]
        current = _rescored(judge, [m for i, m in enumerate(current.members) if i != drop])
    return current


def _mendable(judge: Selector, current: Hypothesis, place: int) -> float:
    """Chi-square of the other members' maps that the member at `place` could take over.

    Maps are never quite right: whoever wins but a little of that mends the others, and is not there.
    """
    member, members = current.members[place], current.members
    rest = [m for m in members if m != member]
    if not rest or judge.frees_hand([member]) or judge.nameless(member):
        return 0.0
    solution = judge.fit(current)
    others = np.concatenate([_theta_of(judge, current, solution, i) for i in range(len(members)) if i != place])
    maps, mine = judge.columns(rest), judge.columns([member])
    before, after = (judge.design.system.left_of(maps, others, c, inflate=current.inflate) for c in (mine[:0], mine))
    return (before - after) / current.inflate


def _rough(judge: Selector, current: Hypothesis, place: int, lost: Float) -> float:
    """Chi-square that rough maps of the other members leave to whoever comes; all of it to hand-eye where motion shifts what edges show."""
    effects = [judge.design.candidates[m].effect for m in current.members]
    if judge.frees_hand([current.members[place]]):
        return np.inf if any(isinstance(e, Motion) for e in effects) else 0.0
    return max((e.ROUGH * lost[i] for i, e in enumerate(effects) if e is not None and i != place), default=0.0)


def _worth(judge: Selector, current: Hypothesis) -> tuple[Float, Float]:
    """Per member: held-out chi-square lost without it, and the same as metres RMS over all pixels."""
    lost = np.array(
        [
            judge.score([m for i, m in enumerate(current.members) if i != place], current.inflate).score - current.score
            for place in range(len(current.members))
        ]
    )
    system = judge.design.system
    return lost, np.sqrt(np.maximum(lost * current.inflate, 0.0) / system.pixels.sum()) * system.sigma


def _theta_of(judge: Selector, hypothesis: Hypothesis, solution: ColumnFit, place: int) -> Float:
    at = [columns for _, _, columns in judge.design.placed(hypothesis.members)]
    return solution.theta[at[place]]


def _without_crowd(judge: Selector, current: Hypothesis) -> tuple[Hypothesis, tuple[str, ...]]:
    """Without the effects beyond the second that explain little, and their names where together they explain much.

    Several small effects together draw almost any form: whoever names them all believes in a coincidence. Very small
    ones make up for what the maps of the others are not exact in, and are nothing by themselves.
    """
    whole, crowd = current, list[str]()
    while (
        len(named := [i for i, m in enumerate(current.members) if not judge.nameless(m) and not judge.frees_hand([m])])
        > judge.config.named_freely
    ):
        _, visible = _worth(judge, current)
        least = min(named, key=lambda i: visible[i])
        if visible[least] ** 2 >= judge.config.small_share * float((visible**2).sum()):
            break
        crowd.append(judge.design.candidates[current.members[least]].name)
        current = _rescored(judge, [m for i, m in enumerate(current.members) if i != least])
    if not set(crowd) - {judge.design.candidates[m].name for m in current.members}:
        return whole, ()  # One part more that deviates is no effect more.
    without = judge.score(current.members, whole.inflate).score - whole.score
    explained = judge.score((), whole.inflate).score - whole.score
    return current, tuple(crowd) if without > judge.config.small_together * explained else ()


def _described(judge: Selector, current: Hypothesis, crowd: tuple[str, ...]) -> Selection:
    lost, visible = _worth(judge, current) if current.members else (np.zeros(0), np.zeros(0))
    ties = tuple(
        () if judge.nameless(m) else _stand_ins(judge, current, place, float(lost[place])) for place, m in enumerate(current.members)
    )
    effects = [judge.design.candidates[m].effect for m in current.members]
    unknown = tuple(e.quantity for _, e in sorted(zip(-lost, effects, strict=True), key=lambda le: le[0]) if isinstance(e, Unknown))
    return Selection(
        current,
        judge.fit(current),
        judge.score((), current.inflate),
        ties,
        visible,
        lost,
        unknown,
        crowd,
    )


def _stand_ins(judge: Selector, current: Hypothesis, place: int, worth: float) -> tuple[int, ...]:
    """Candidates of other names that the data cannot tell from the member at `place`, which is `worth` that much chi-square."""
    d, config = judge.design, judge.config
    member = current.members[place]
    rest = [m for i, m in enumerate(current.members) if i != place]
    taken = {d.candidates[m].name for m in current.members}
    found: dict[str, tuple[float, int]] = {}
    for i, candidate in enumerate(d.candidates):
        if candidate.name in taken or judge.nameless(i):
            continue
        trial = judge.score([*rest[:place], i, *rest[place:]], current.inflate)
        if trial.score - current.score > min(config.tie_gain, max(config.tie_share * worth, config.tie_least)) or not judge.plausible(
            trial
        ):
            continue
        if not _hides(judge, current, place, member, i, rest):
            continue
        if candidate.name not in found or trial.score < found[candidate.name][0]:
            found[candidate.name] = (trial.score, i)
    return tuple(i for _, i in sorted(found.values()))


def _hides(judge: Selector, current: Hypothesis, place: int, member: int, other: int, rest: Sequence[int]) -> bool:
    """Whether `other`, with pose and the rest, leaves little of the member's map."""
    design = judge.design
    if design.candidates[member].effect is None or design.candidates[other].effect is None:
        return True  # A free X is judged by its held-out score alone.
    theta = _theta_of(judge, current, judge.fit(current), place)
    target = design.groups[member]
    before, after = (design.system.left_of(target, theta, judge.columns(c), inflate=current.inflate) for c in (rest, [*rest, other]))
    return after < judge.config.tie_left * max(before, 1e-12)
