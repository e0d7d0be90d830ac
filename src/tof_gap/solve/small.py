# SPDX-License-Identifier: Apache-2.0
"""Effects that each explain little, and much only together."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tof_gap.solve.worth import rescored, worth

if TYPE_CHECKING:
    from tof_gap.solve.judge import Hypothesis, Selector


def without_small(judge: Selector, current: Hypothesis) -> tuple[Hypothesis, tuple[str, ...]]:
    """The hypothesis without the effects beyond the second that each explain little, and their names where together they explain much.

    Several small effects together fit almost any error, and so many causes at once are unlikely. Very small ones only correct inexact
    maps of the others.
    """
    whole, small = current, list[str]()
    while (
        len(named := [i for i, m in enumerate(current.members) if not judge.is_free(m) and not judge.frees_hand([m])])
        > judge.config.named_freely
    ):
        _, visible = worth(judge, current)
        least = min(named, key=lambda i: visible[i])
        if visible[least] ** 2 >= judge.config.small_share * float((visible**2).sum()):
            break
        small.append(judge.design.candidates[current.members[least]].name)
        current = rescored(judge, [m for i, m in enumerate(current.members) if i != least])
    if not set(small) - {judge.design.candidates[m].name for m in current.members}:
        return whole, ()  # A second part that deviates is the same effect.
    without = judge.score(current.members, whole.inflate).score - whole.score
    explained = judge.score((), whole.inflate).score - whole.score
    return current, tuple(small) if without > judge.config.small_together * explained else ()
