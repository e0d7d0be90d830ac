# SPDX-License-Identifier: Apache-2.0
"""Selection of effects: added one by one, each by the chi-square that it explains on views that it was not fitted to."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from tof_gap.solve.choose.between import shown, with_suspect
from tof_gap.solve.choose.judge import Hypothesis, Selector
from tof_gap.solve.choose.lens import with_lens
from tof_gap.solve.choose.small import without_small
from tof_gap.solve.choose.ties import stand_ins
from tof_gap.solve.choose.worth import coefficients, rescored, visible_m, worth
from tof_gap.solve.hypotheses.candidate import HAND_EYE
from tof_sensor.curve import CurveEffect

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from tof_align.columns import ColumnFit
    from tof_core.arrays import Float
    from tof_gap.limits.solve import SelectLimits
    from tof_gap.solve.hypotheses.columns import Design


@dataclass(frozen=True, slots=True, eq=False)
class Selection:
    """The chosen hypothesis.

    fit: of the chosen hypothesis; ties: for each member, candidates that could stand in for it; unknown: observables of chosen free
    functions, most first; small_together: effects that each explain little, and much together; suspected: members that predict held-out
    views better, and that too few views show to be asserted; fullest: members before
    small effects beyond the second were dropped, and small terms of others; empty where small effects explain much together.
    """

    chosen: Hypothesis
    fit: ColumnFit
    ties: tuple[tuple[int, ...], ...]
    unknown: tuple[str, ...]
    small_together: tuple[str, ...]
    suspected: tuple[int, ...] = ()
    fullest: tuple[int, ...] = ()


def select(design: Design, config: SelectLimits, begun: Sequence[int] = ()) -> Selection:
    """Add, exchange and drop effects until no held-out chi-square is won; then find the effects that the session cannot distinguish.

    The search starts twice, without effects and from the members `begun`, and the better result is chosen: an effect that explains most
    by itself may stand in for several others.
    """
    judge = Selector(design, config)
    grown = [_grown(judge, members) for members in dict.fromkeys([(), tuple(begun)])]
    ends = [_plain(judge, full) for full in grown]
    place = min(range(len(ends)), key=lambda i: judge.score(ends[i].members, ends[0].inflate).score)
    current, small = without_small(judge, ends[place])
    current, suspected = with_suspect(judge, with_lens(judge, _prune(judge, with_mount(judge, _prune(judge, current)))))
    fullest = () if small or set(grown[place].members) <= set(current.members) else tuple(grown[place].members)
    return replace(_described(judge, current, small), suspected=suspected, fullest=fullest)


def _grown(judge: Selector, members: Sequence[int]) -> Hypothesis:
    """The hypothesis that additions and exchanges make of `members`, without weak members."""
    current = judge.score(members, judge.inflation(members))
    while len({judge.design.candidates[m].name for m in current.members}) < judge.config.most:
        better = _best_addition(judge, current)
        if better is None:
            break
        current = _curved(judge, _exchange(judge, better))
    return _prune(judge, current)


def narrowed(design: Design, config: SelectLimits, selection: Selection, members: Sequence[int]) -> Selection:
    """The selection with these of its members alone, fitted anew."""
    judge = Selector(design, config)
    left = _described(judge, rescored(judge, members), selection.small_together)
    return replace(
        left,
        suspected=tuple(m for m in selection.suspected if m in members),
        fullest=selection.fullest,
    )


def _best_addition(judge: Selector, current: Hypothesis, tried: Iterable[int] | None = None) -> Hypothesis | None:
    """The hypothesis with the best one of the candidates `tried` (all by default) that wins what it must; None where none does."""
    best: Hypothesis | None = None
    added = judge.beside(current.members, len(current.members), current.inflate)
    for i in range(len(judge.design.candidates)) if tried is None else tried:
        if judge.repeats(i, current.members):
            continue
        trial = added(i)
        if current.score - trial.score < judge.gain(i) or not won_steadily(current, trial, judge.gain(i), judge.config):
            continue
        if (best is None or trial.score < best.score) and judge.plausible(trial):
            best = trial
    return None if best is None else rescored(judge, best.members)


def won_steadily(before: Hypothesis, after: Hypothesis, gain: float, limits: SelectLimits) -> bool:
    """Whether more than one view gains: without the best view, `steady` of the gain remains, or the required gain."""
    won = before.held_out - after.held_out
    return bool(won.sum() - won.max() > min(limits.steady * won.sum(), gain) or len(won) < limits.steady_views)


def _exchange(judge: Selector, current: Hypothesis) -> Hypothesis:
    """Replace members one at a time while another candidate does better in their place."""
    improved = True
    while improved:
        improved = False
        for place in range(len(current.members)):
            rest = [m for i, m in enumerate(current.members) if i != place]
            exchanged = judge.beside(rest, place, current.inflate)
            for i in range(len(judge.design.candidates)):
                if i in current.members or judge.repeats(i, rest):
                    continue
                trial = exchanged(i)
                if trial.score < current.score - judge.config.exchange and judge.plausible(trial):
                    current = trial
                    improved = True
    return rescored(judge, current.members)


def _curved(judge: Selector, current: Hypothesis) -> Hypothesis:
    """Replace formulas by a curve of the same effect that explains clearly more: the rest would be attributed to another effect."""
    candidates = judge.design.candidates
    for place, member in enumerate(current.members):
        if judge.is_free(member) or _has_no_formula(judge, member):
            continue
        curve = next((i for i, c in enumerate(candidates) if c.name == candidates[member].name and _has_no_formula(judge, i)), None)
        if curve is None or curve in current.members:
            continue
        trial = judge.score([*current.members[:place], curve, *current.members[place + 1 :]], current.inflate)
        won = float((current.held_out - trial.held_out).sum())
        if won > judge.config.unknown and won > judge.config.unknown_share * worth(judge, current)[0][place]:
            current = rescored(judge, trial.members)
    return current


def with_mount(judge: Selector, current: Hypothesis) -> Hypothesis:
    """The hypothesis with hand-eye, where held-out views gain by it what they must.

    Hand-eye explains errors of the arm, and wins less chi-square than a weak effect of many pixels: the search may have ended before it.
    It is free, too, where it contradicts its stated calibration.
    """
    candidates = judge.design.candidates
    mounts = [i for i, c in enumerate(candidates) if c.name == HAND_EYE]
    if mounts and judge.contradicts_mount(current):
        return rescored(judge, [*current.members, *mounts])
    return _best_addition(judge, current, mounts) or current


def _has_no_formula(judge: Selector, member: int) -> bool:
    effect = judge.design.candidates[member].effect
    return isinstance(effect, CurveEffect) and effect.free_form


def _prune(judge: Selector, current: Hypothesis) -> Hypothesis:
    """Drop members whose absence costs little."""
    while current.members and (least := weak(judge, current)):
        drop = min(least)[1]
        current = rescored(judge, [m for i, m in enumerate(current.members) if i != drop])
    return current


def weak(judge: Selector, current: Hypothesis) -> list[tuple[float, int]]:
    """Members whose absence costs little: what each explains (metres RMS over all pixels), and its place."""
    lost, visible = worth(judge, current)
    totals, of_effect = _totals(judge, current, visible), _of_effect(judge, current, visible)
    return [
        (v, i)
        for i, (gain, v) in enumerate(zip(lost, visible, strict=True))
        if not judge.needed_by_calibration(judge.design.candidates[current.members[i]].name, current)
        and (
            gain < judge.gain(current.members[i])
            or of_effect[i] < judge.share(current.members[i]) * totals[i]
            or gain < judge.config.absorbed * _absorbable(judge, current, i)
            or gain < _lacking(judge, current, i)
            or gain < _rough(judge, current, i, lost)
            or gain < _on_one_part(judge, current, i)
            or not shown(judge, current, i)
        )
    ]


def _totals(judge: Selector, current: Hypothesis, visible: Float) -> list[float]:
    """Per member: energy (m^2) of which its effect must explain a share, since the maps of the others are never exact.

    That is the energy of all members, but without that of patterns in the image (`Effect.IN_IMAGE`) for effects that are none.
    """
    effects = [judge.design.candidates[m].effect for m in current.members]
    in_image = np.array([e is not None and e.IN_IMAGE for e in effects], bool)
    whole, changing = float((visible**2).sum()), float((visible[~in_image] ** 2).sum())
    return [whole if fixed else changing for fixed in in_image]


def _of_effect(judge: Selector, current: Hypothesis, visible: Float) -> list[float]:
    """Per member: energy (m^2) that all members of its effect explain. A second part that deviates is the same effect: it adds no name."""
    names = [judge.design.candidates[m].name if not judge.is_free(m) else m for m in current.members]
    return [sum(float(v) ** 2 for v, other in zip(visible, names, strict=True) if other == name) for name in names]


def _plain(judge: Selector, current: Hypothesis) -> Hypothesis:
    """Replace members whose own terms explain too little by the effect that they are without these terms (`Effect.rest`)."""
    names = [c.name for c in judge.design.candidates]
    for place, member in enumerate(current.members):
        effect = judge.design.candidates[member].effect
        if effect is None or effect.rest not in names:
            continue
        rest = names.index(effect.rest)
        trial = judge.score([*current.members[:place], rest, *current.members[place + 1 :]], current.inflate)
        own = float(visible_m(judge, current, trial.score - current.score))
        visible = worth(judge, current)[1]
        total = float((visible**2).sum())
        if judge.apart is not None:  # No pose absorbs an offset: whole, it would hide millimetres of the effect's own.
            total -= float(visible[place]) ** 2 - own**2
        least2 = max(judge.share(member) * total, (judge.config.own_mm * 1e-3) ** 2)
        if not judge.repeats(rest, current.members) and own**2 < least2 and judge.plausible(trial):
            current = rescored(judge, trial.members)
    return current


def _lacking(judge: Selector, current: Hypothesis, place: int) -> float:
    """Chi-square that the member at `place` may win because the maps of other members are incomplete (`Effect.LACKS`)."""
    effects = [judge.design.candidates[m].effect for m in current.members]
    of_part = getattr(effects[place], "part", -1) >= 0
    short = [(i, e.LACKS_ON_A_PART if of_part else e.LACKS) for i, e in enumerate(effects) if e is not None and i != place]
    return max((lacks * _along(judge, current, place, [i]) for i, lacks in short if lacks), default=0.0)


def _absorbable(judge: Selector, current: Hypothesis, place: int) -> float:
    """Chi-square of the maps of all other effects that the member at `place` could absorb.

    Maps are never exact: a member that gains only a small part of it corrects the other maps and is no effect of its own. Members of its
    own effect, such as waves of almost one length, add no name: what they gain on held-out views is all that is asked.
    """
    names = [judge.design.candidates[m].name for m in current.members]
    others = [i for i, name in enumerate(names) if name != names[place]]
    return 0.0 if judge.is_free(current.members[place]) else _along(judge, current, place, others)


def _along(judge: Selector, current: Hypothesis, place: int, others_at: Sequence[int]) -> float:
    """Chi-square of the maps of the members at `others_at` that columns of the member at `place` could explain."""
    member, members = current.members[place], current.members
    if not others_at or judge.frees_hand([member]):
        return 0.0
    solution = judge.fit(current)
    others = np.concatenate([coefficients(judge, current, solution, i) for i in others_at])
    maps = judge.design.own([members[i] for i in others_at])
    before, after = (judge.design.system.left_of(maps, others, judge.columns(m), inflate=current.inflate) for m in ((), (member,)))
    return (before - after) / current.inflate


def _rough(judge: Selector, current: Hypothesis, place: int, lost: Float) -> float:
    """Chi-square that errors of the other members' maps may leave; infinite for hand-eye beside motion, which shifts edges.

    Maps leave residuals; hand-eye hardly explains residuals, but errors of the arm against its prior.
    """
    effects = [judge.design.candidates[m].effect for m in current.members]
    member = current.members[place]
    if judge.frees_hand([member]) and any(e is not None and e.SMEARS for e in effects):
        return np.inf
    if judge.frees_hand([member]):
        return 0.0
    return max((e.ROUGH * lost[i] for i, e in enumerate(effects) if e is not None and i != place), default=0.0)


def _on_one_part(judge: Selector, current: Hypothesis, place: int) -> float:
    """Chi-square that the member at `place` must explain where another effect acts on its part: the two take each other's place."""
    effects = [judge.design.candidates[m].effect for m in current.members]
    part = getattr(effects[place], "part", -1)
    shared = [i for i, e in enumerate(effects) if getattr(e, "part", -1) == part]
    if part < 0 or len({judge.design.candidates[current.members[i]].name for i in shared}) < 2:
        return 0.0
    without = judge.score([m for i, m in enumerate(current.members) if i not in shared], current.inflate)
    return judge.config.on_one_part * (without.score - current.score)


def _described(judge: Selector, current: Hypothesis, small: tuple[str, ...]) -> Selection:
    lost = worth(judge, current)[0] if current.members else np.zeros(0)
    ties = tuple(() if judge.is_free(m) else stand_ins(judge, current, place) for place, m in enumerate(current.members))
    free = [judge.design.candidates[m].free for m in current.members]
    unknown = tuple(f.quantity for _, f in sorted(zip(-lost, free, strict=True), key=lambda lf: lf[0]) if f is not None)
    return Selection(current, judge.fit(current), ties, unknown, small)
