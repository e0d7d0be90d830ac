# SPDX-License-Identifier: Apache-2.0
"""Which sets of effects the second judge weighs: at most one form of a name, its forms found by a search of its own."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from math import comb, log
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import betaln

from benchmarks.second_opinion.evidence import Evidence

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from tof_gap.solve.hypotheses.candidate import Candidate
    from tof_gap.solve.hypotheses.columns import Design

SIZES_M = (1e-3, 3e-3, 10e-3)
"""RMS of an effect's map a priori: the small, the usual and the large strength of docs/effects.md, each as likely."""
USUAL_M = 3e-3
TOGETHER = 4
"""Names in a set at most: more than any session has, healthy ones' small errors within stated calibrations aside."""
FORMS = 20
"""Forms that the sampler chooses from: all sets of four of them are some thousand integrals."""
TRIED = 3
"""Forms of a name that each step of the search keeps."""
REPEATED = 8
"""Candidates of a repeatable name (parts, periods) in one form at most."""
ROUNDS = 5
SETTLED = 0.02
"""Relative change of the noise's inflation below which the search ends."""


@dataclass(frozen=True, slots=True, order=True)
class Form:
    """One way in which a name may be there: a candidate, or several where the effect repeats."""

    name: str
    members: tuple[int, ...]


@dataclass(slots=True, eq=False)
class Search:
    """Sets of forms over one evidence, scored by marginal likelihood times prior; what was tried is kept in `pool` with its best score."""

    evidence: Evidence
    pool: dict[Form, float] = field(default_factory=dict)

    @property
    def design(self) -> Design:
        """All hypotheses."""
        return self.evidence.design

    @property
    def names(self) -> list[str]:
        """Every name that the session was asked for."""
        return sorted({c.name for c in self.design.candidates})

    def score(self, forms: Iterable[Form]) -> float:
        """ln of marginal likelihood, with maps of the usual size, and prior of a set."""
        chosen = tuple(forms)
        members = [m for f in chosen for m in f.members]
        prior = log_prior_count(len(chosen), len(self.names)) + sum(self.log_prior(f) for f in chosen)
        return self.evidence.log_likelihood(members, USUAL_M) + prior

    def log_prior(self, form: Form) -> float:
        """ln of the probability of a form among its name's: each number of repeats half as likely as one less, all choices alike."""
        count, n = len(form.members), self._count(form.name)
        return -log(comb(n, count)) - (count * log(2.0) if _repeatable(self.design.candidates[form.members[0]]) else 0.0)

    def _count(self, name: str) -> int:
        return Counter(c.name for c in self.design.candidates)[name]

    def best(self, name: str, beside: Sequence[Form]) -> tuple[float, Form]:
        """The best form of a name beside others, and its score; the first of all that were tried go into the pool."""
        mine = [i for i, c in enumerate(self.design.candidates) if c.name == name]
        tried = self._scored([Form(name, (i,)) for i in mine], beside)
        end = tried[0]
        while len(end[1].members) < REPEATED:
            more = [Form(name, (*end[1].members, i)) for i in mine if self._may_join(i, end[1].members)]
            if not more:
                break
            grown = self._scored(more, beside)[0]
            if grown[0] <= end[0]:
                break
            tried.append(end := grown)
        tried.sort(reverse=True)
        for value, form in tried[:TRIED]:
            self.pool[form] = max(value, self.pool.get(form, -np.inf))
        return tried[0]

    def _may_join(self, one: int, members: Sequence[int]) -> bool:
        """Whether a form may hold a candidate besides its members, as a hypothesis of the diagnosis may."""
        candidates = self.design.candidates
        return one not in members and not any(candidates[one].excludes(candidates[m]) for m in members)

    def _scored(self, forms: Sequence[Form], beside: Sequence[Form]) -> list[tuple[float, Form]]:
        return sorted(((self.score([*beside, f]), f) for f in forms), reverse=True)

    def grown(self, begun: Mapping[str, Form]) -> dict[str, Form]:
        """The set that another begins: forms added and exchanged while the score rises."""
        current = dict(begun)
        best = self.score(current.values())
        while True:
            steps = [self._step(current, without) for without in (None, *current)]
            score, after = max(steps, key=lambda step: step[0])
            if score <= best:
                return current
            current, best = after, score

    def _step(self, current: Mapping[str, Form], without: str | None) -> tuple[float, dict[str, Form]]:
        """The best set with one name more than `current`, or with another form or name in the place of `without`, or without it."""
        rest = {n: f for n, f in current.items() if n != without}
        options = [(self.score(rest.values()), rest)] if without is not None else []
        if len(rest) < TOGETHER:
            for name in self.names:
                if name not in rest:
                    score, form = self.best(name, list(rest.values()))
                    options.append((score, rest | {name: form}))
        return max(options, key=lambda option: option[0], default=(-np.inf, rest))


def log_prior_count(count: int, names: int) -> float:
    """ln of the probability of one set of `count` of so many names: all inclusion rates with one name in the mean, Beta(1, names)."""
    return float(betaln(1 + count, 2 * names - count) - betaln(1, names))


def searched(design: Design, begun: Sequence[int], neighbours: float) -> tuple[Search, float]:
    """The search at the inflation of noise that its own best set leaves, from no effect and from the members `begun`; and that inflation.

    The inflation is the diagnosis' formula (errors that neighbours share count once), of this judge's best set.
    """
    best: dict[str, Form] = {}
    theirs = by_name(design, begun)
    inflate = inflation(design, best, neighbours)
    for _ in range(ROUNDS - 1):
        search = Search(Evidence.of(design, inflate))
        ends = [search.grown(start) for start in ({}, best, theirs)]
        best = max(ends, key=lambda end: search.score(end.values()))
        before, inflate = inflate, inflation(design, best, neighbours)
        if abs(inflate / before - 1) < SETTLED:
            return search, before
    search = Search(Evidence.of(design, inflate))
    for start in ({}, best, theirs):
        search.grown(start)
    return search, inflate


def by_name(design: Design, members: Sequence[int]) -> dict[str, Form]:
    """The first `TOGETHER` names of a diagnosis' members, as forms."""
    names = list(dict.fromkeys(design.candidates[m].name for m in members))[:TOGETHER]
    return {n: Form(n, tuple(m for m in members if design.candidates[m].name == n)[:REPEATED]) for n in names}


def _repeatable(candidate: Candidate) -> bool:
    """Whether a form may hold several of its name: one per part, or one per observable."""
    return candidate.free is not None or (candidate.effect is not None and candidate.effect.REPEATS)


def inflation(design: Design, forms: Mapping[str, Form], neighbours: float) -> float:
    """By how much the weight of pixels is divided when these forms are in."""
    members = [m for f in forms.values() for m in f.members]
    hand = any(design.candidates[m].effect is None and design.candidates[m].free is None for m in members)
    return design.system.inflation(design.active(members), neighbours, free_hand=hand)


def kept(pool: Mapping[Form, float]) -> list[Form]:
    """The forms that the sampler chooses from: the best of every name, then the second ones, best first; by name."""
    ranked = sorted(pool, key=lambda form: -pool[form])
    turn = {form: sum(f.name == form.name for f in ranked[:i]) for i, form in enumerate(ranked)}
    first, second = ([form for form in ranked if turn[form] == t] for t in (0, 1))
    return sorted([*first, *second[: max(FORMS - len(first), 0)]])
