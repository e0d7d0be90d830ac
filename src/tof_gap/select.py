# SPDX-License-Identifier: Apache-2.0
"""Which effects: added one by one, each by what it explains on views it was not fitted to."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tof_core.config import param
from tof_gap.candidates import HAND_EYE
from tof_gap.observable import Unknown
from tof_gap.system import cross_validate, fit, map_energy
from tof_sensor.effects.cad_deviation import CadDeviation
from tof_sensor.effects.motion import Motion

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from tof_core.arrays import Float, Ints
    from tof_gap.columns import Design
    from tof_gap.system import Fit


@dataclass(frozen=True, slots=True)
class SelectConfig:
    """When an effect is believed."""

    gain: float = param(
        30.0, "held-out chi-square an effect of one shape must win (discrepancy taken out); n shapes pay 2 ln n more", low=1.0
    )
    hand_gain: float = param(10.0, "the same for hand-eye: the arms' own spread, which is known, speaks for it, and not pixels", low=1.0)
    share: float = param(0.015, "of the visible gap's energy that an effect must explain, left out of all", low=0.0, high=1.0)
    tie_left: float = param(0.25, "share of a map's visible energy below which another effect hides it", low=0.0, high=1.0)
    tie_gain: float = param(20.0, "held-out chi-square by which tied effects may differ at most", low=0.0)
    most: int = param(5, "effects named at most", low=1, high=12)
    unknown: float = param(25.0, "held-out chi-square that a function of an observable pays for not being a named effect", low=0.0)
    crowd_share: float = param(0.15, "of the visible gap's energy that an effect beyond the second must explain", low=0.0, high=1.0)
    crowd_least: float = param(
        0.06, "of the explained chi-square, what such effects must explain together to be unknown", low=0.0, high=1.0
    )
    unknown_share: float = param(0.03, "of the explained chi-square that it pays besides, and must win to stay", low=0.0, high=1.0)
    folds: int = param(6, "parts into which the views are dealt for held-out scores", low=2, high=50)


@dataclass(frozen=True, slots=True, eq=False)
class Hypothesis:
    """A set of candidates with its held-out chi-square per view (V,), and what it pays for members that are no named effects."""

    members: tuple[int, ...]
    held_out: Float
    inflate: float
    price: float = 0.0

    @property
    def score(self) -> float:
        """Held-out chi-square of all views, price included; smaller explains more."""
        return float(self.held_out.sum()) + self.price


@dataclass(frozen=True, slots=True, eq=False)
class Selection:
    """The chosen hypothesis, the empty one, and for each member those that could stand in for it."""

    chosen: Hypothesis
    fit: Fit
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


MANIFOLD = (CadDeviation.NAME, Unknown.NAME)
"""What may be there more than once: every part deviates by itself."""


class Selector:
    """Held-out scores of hypotheses over one design."""

    def __init__(self, design: Design, config: SelectConfig) -> None:
        """Deal the views into folds, every station in every fold as evenly as it goes."""
        self.design, self.config = design, config
        self.folds = deal(design.system.station.tolist(), config.folds)
        self._empty: dict[float, float] = {}

    def gain(self, member: int) -> float:
        """Held-out chi-square that a candidate must win: what was tried at many shapes finds one that fits by chance."""
        if self.frees_hand([member]):
            return self.config.hand_gain
        name = self.design.candidates[member].name
        return self.config.gain + 2.0 * float(np.log(sum(c.name == name for c in self.design.candidates)))

    def share(self, member: int) -> float:
        """Of the visible gap's energy that a candidate must explain; hand-eye hardly shows in it, the arms take it up."""
        if self.frees_hand([member]):
            return 0.0
        return self.config.unknown_share if self.nameless(member) else self.config.share

    def columns(self, members: Iterable[int]) -> Ints:
        """Columns of a set of candidates."""
        groups = [self.design.groups[m] for m in members]
        return np.concatenate([np.zeros(0, np.int64), *groups]).astype(np.int64)

    def frees_hand(self, members: Iterable[int]) -> bool:
        """Whether hand-eye is among them."""
        return any(self.design.candidates[m].name == HAND_EYE for m in members)

    def score(self, members: Sequence[int], inflate: float) -> Hypothesis:
        """Fit on all folds but one, judge on that one, for every fold."""
        active, free = self.columns(members), self.frees_hand(members)
        held_out = cross_validate(self.design.system, active, self.folds, inflate=inflate, free_hand=free)
        return Hypothesis(tuple(members), held_out, inflate, self._price(members, held_out, inflate))

    def _price(self, members: Sequence[int], held_out: Float, inflate: float) -> float:
        """What members that are no effects pay: a form that physics foretells is never exact, one that is drawn freely always is."""
        free = sum(self.nameless(m) for m in members)
        if not free:
            return 0.0
        if inflate not in self._empty:
            self._empty[inflate] = self.score((), inflate).score
        explained = self._empty[inflate] - float(held_out.sum())
        return free * (self.config.unknown + self.config.unknown_share * max(explained, 0.0))

    def nameless(self, member: int) -> bool:
        """Whether a candidate is a function of an observable and no effect."""
        return isinstance(self.design.candidates[member].effect, Unknown)

    def repeats(self, member: int, members: Iterable[int]) -> bool:
        """Whether one of the members is this candidate, or another shape of an effect that cannot be there twice."""
        name = self.design.candidates[member].name
        return member in members or (name not in MANIFOLD and any(self.design.candidates[m].name == name for m in members))

    def fit(self, hypothesis: Hypothesis) -> Fit:
        """The hypothesis fitted to all views."""
        members = hypothesis.members
        return fit(self.design.system, self.columns(members), inflate=hypothesis.inflate, free_hand=self.frees_hand(members))

    def plausible(self, hypothesis: Hypothesis) -> bool:
        """Whether every coefficient lies within its parameter's bounds, give or take two of its errors, and motion shows at edges."""
        solution, start = self.fit(hypothesis), 0
        sd = np.sqrt(np.diag(solution.theta_cov))
        for member in hypothesis.members:
            group, effect = self.design.groups[member], self.design.candidates[member].effect
            at = slice(start, start + len(group))
            start += len(group)
            if effect is None or len(effect.LINEAR) != len(group):
                continue
            if isinstance(effect, Motion):
                # Without what it does at edges it is lateness, which has a name of its own.
                at_edges, cov = solution.theta[at][1:], solution.theta_cov[at, at][1:, 1:]
                if at_edges @ np.linalg.solve(cov, at_edges) < self.config.gain:
                    return False
            low, high = effect.bounds
            value, error = solution.theta[at] / self.design.scale[group], 2 * sd[at] / self.design.scale[group]
            if ((value + error < low) | (value - error > high)).any():
                return False
        return True

    def inflation(self, members: Sequence[int]) -> float:
        """How much less than white noise's a pixel's weight is, from what the members leave.

        With E the chi-square of all n pixels after the fit, white noise leaves E = n. What is left
        above is shared by neighbours and must not count once per pixel.
        """
        system = self.design.system
        left = fit(system, self.columns(members), free_hand=self.frees_hand(members)).energy
        return 1.0 + max(left / float(system.n.sum()) - 1.0, 0.0) * NEIGHBOURS


NEIGHBOURS = 30.0
"""Drawn pixels that share one error where the residual is structured."""


def deal(stations: Sequence[int], folds: int) -> Ints:
    """(V,) fold of each view: dealt in turn within each station; every fold leaves every station some views."""
    out = np.zeros(len(stations), np.int64)
    offset = 0
    for s in sorted(set(stations)):
        index = np.flatnonzero(np.asarray(stations) == s)
        out[index] = (np.arange(len(index)) + offset) % min(folds, len(stations))
        offset += len(index)
    return out


def select(design: Design, config: SelectConfig) -> Selection:
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


def _rescored(judge: Selector, members: Sequence[int]) -> Hypothesis:
    return judge.score(members, judge.inflation(members))


def _best_addition(judge: Selector, current: Hypothesis) -> Hypothesis | None:
    best: Hypothesis | None = None
    for i in range(len(judge.design.candidates)):
        if judge.repeats(i, current.members):
            continue
        trial = judge.score((*current.members, i), current.inflate)
        if current.score - trial.score < judge.gain(i) or not _steady(current, trial):
            continue
        if (best is None or trial.score < best.score) and judge.plausible(trial):
            best = trial
    return None if best is None else _rescored(judge, best.members)


def _steady(before: Hypothesis, after: Hypothesis) -> bool:
    """Whether the win is no single view's: it stands with the best view taken away."""
    won = before.held_out - after.held_out
    return bool(won.sum() - won.max() > 0.25 * won.sum() or len(won) < 4)


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
                if trial.score < current.score - 1.0 and judge.plausible(trial):
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
            if gain < judge.gain(current.members[i]) or v * v < judge.share(current.members[i]) * total
        ]
        if not weak:
            break
        drop = min(weak)[1]
        current = _rescored(judge, [m for i, m in enumerate(current.members) if i != drop])
    return current


def _worth(judge: Selector, current: Hypothesis) -> tuple[Float, Float]:
    """Per member: held-out chi-square lost without it, and the same as metres RMS over all pixels."""
    lost = np.array(
        [
            judge.score([m for i, m in enumerate(current.members) if i != place], current.inflate).score - current.score
            for place in range(len(current.members))
        ]
    )
    system = judge.design.system
    return lost, np.sqrt(np.maximum(lost * current.inflate, 0.0) / system.n.sum()) * system.sigma


def _theta_of(judge: Selector, hypothesis: Hypothesis, solution: Fit, place: int) -> Float:
    ends = np.cumsum([0, *(len(judge.design.groups[m]) for m in hypothesis.members)])
    return solution.theta[ends[place] : ends[place + 1]]


def _without_crowd(judge: Selector, current: Hypothesis) -> tuple[Hypothesis, tuple[str, ...]]:
    """Without the effects beyond the second that explain little, and their names where together they explain much.

    Several small effects together draw almost any form: whoever names them all believes in a coincidence. Very small
    ones make up for what the maps of the others are not exact in, and are nothing by themselves.
    """
    whole, crowd = current, list[str]()
    while len(named := [i for i, m in enumerate(current.members) if not judge.nameless(m) and not judge.frees_hand([m])]) > 2:
        _, visible = _worth(judge, current)
        least = min(named, key=lambda i: visible[i])
        if visible[least] ** 2 >= judge.config.crowd_share * float((visible**2).sum()):
            break
        crowd.append(judge.design.candidates[current.members[least]].name)
        current = _rescored(judge, [m for i, m in enumerate(current.members) if i != least])
    if not crowd:
        return whole, ()
    without = judge.score(current.members, whole.inflate).score - whole.score
    explained = judge.score((), whole.inflate).score - whole.score
    return current, tuple(crowd) if without > judge.config.crowd_least * explained else ()


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


TIE_SHARE = 0.35
"""Of what a member is worth, the part that a stand-in may lose."""


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
        if trial.score - current.score > min(config.tie_gain, max(TIE_SHARE * worth, 4.0)) or not judge.plausible(trial):
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
    before, after = (map_energy(design.system, target, theta, judge.columns(c), inflate=current.inflate) for c in (rest, [*rest, other]))
    return after < judge.config.tie_left * max(before, 1e-12)
