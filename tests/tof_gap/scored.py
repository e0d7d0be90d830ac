# SPDX-License-Identifier: Apache-2.0
"""A selector whose scores are given: what the steps of the selection do is then known."""

from __future__ import annotations

from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np

from tof_gap.limits.solve import SelectLimits
from tof_gap.solve.choose.judge import Hypothesis

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

VIEWS = 6
NOTHING = 1000.0
"""Held-out chi-square of no effect at all."""


class Judge:
    """Stands for a selector: candidates by letter, the score of every hypothesis by the letters of its members."""

    def __init__(
        self,
        scores: Mapping[str, float],
        names: Sequence[str] | None = None,
        *,
        effects: Mapping[str, Any] | None = None,
        free: str = "",
        hand: str = "",
        lens: str = "",
        late: str = "",
        mount: str = "",
        off: str = "",
        implausible: Sequence[str] = (),
        **limits: float,
    ) -> None:
        self.letters = sorted({letter for members in scores for letter in members})
        self.scores, self.free, self.hand, self.lens, self.implausible = scores, free, hand, lens, set(implausible)
        self.late, self.mount, self.off = late, mount, off
        self.config = SelectLimits(**limits)  # type: ignore[arg-type]
        self.scored: list[str] = []
        self.apart = None
        called = names or self.letters
        candidates = [
            SimpleNamespace(name=name, effect=(effects or {}).get(letter), free=None)
            for letter, name in zip(self.letters, called, strict=True)
        ]
        self.design: Any = SimpleNamespace(
            candidates=candidates,
            groups=tuple(np.array([i]) for i in range(len(candidates))),
            system=SimpleNamespace(pixels=np.full(4, 25.0), sigma=2e-3),
            without=lambda members, name: tuple(m for m in members if candidates[m].name != name),
        )

    def text(self, members: Sequence[int]) -> str:
        return "".join(sorted(self.letters[m] for m in members))

    def score(self, members: Sequence[int], inflate: float) -> Hypothesis:
        self.scored.append(self.text(members))
        whole = self.scores[self.text(members)] if members else NOTHING
        return Hypothesis(tuple(members), np.full(VIEWS, whole / VIEWS), inflate)

    def beside(self, rest: Sequence[int], place: int, inflate: float) -> Callable[[int], Hypothesis]:
        return lambda i: self.score([*rest[:place], i, *rest[place:]], inflate)

    def inflation(self, members: Sequence[int]) -> float:
        return 1.0 + len(members)

    def plausible(self, hypothesis: Hypothesis) -> bool:
        return self.text(hypothesis.members) not in self.implausible

    def repeats(self, member: int, members: Sequence[int]) -> bool:
        return self.design.candidates[member].name in {self.design.candidates[m].name for m in members}

    def gain(self, member: int) -> float:
        return self.config.hand_gain if self.letters[member] in self.hand else self.config.gain

    def share(self, _: int) -> float:
        return self.config.share

    def is_free(self, member: int) -> bool:
        return self.letters[member] in self.free

    def against_priors(self, member: int) -> bool:
        return self.letters[member] in self.hand + self.lens

    def needed_by_calibration(self, name: str, hypothesis: Hypothesis) -> bool:
        rest = self.design.without(hypothesis.members, name)
        return self._is_one_of(name, self.lens) or (self._is_one_of(name, self.hand) and self.text(rest) == self.off)

    def contradicts_mount(self, hypothesis: Hypothesis) -> bool:
        return self.text(hypothesis.members) == self.off

    def needed_by_mount(self, name: str, _: Hypothesis) -> bool:
        return self._is_one_of(name, self.mount)

    def needed_by_robot(self, name: str, _: Hypothesis) -> bool:
        return self._is_one_of(name, self.late)

    def _is_one_of(self, name: str, letters: str) -> bool:
        return any(self.design.candidates[self.letters.index(letter)].name == name for letter in letters)

    def frees_hand(self, members: Sequence[int]) -> bool:
        return any(self.letters[m] in self.hand for m in members)


def hypothesis(judge: Any, text: str, inflate: float = 1.0) -> Hypothesis:
    return judge.score([judge.letters.index(letter) for letter in text], inflate)  # type: ignore[no-any-return]


def named(judge: Any, found: Hypothesis | None) -> str | None:
    return None if found is None else judge.text(found.members)


def effect(**facts: Any) -> Any:
    return SimpleNamespace(**{"rest": "", "LACKS": 0.0, "LACKS_ON_A_PART": 0.0, "ROUGH": 0.0, "SMEARS": False, "IN_IMAGE": False, **facts})
