# SPDX-License-Identifier: Apache-2.0
"""Effects that each explain little, and much only together."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tof_gap.solve.choose.worth import rescored, visible_m, worth
from tof_sensor.effects.motion import Motion

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_gap.solve.choose.judge import Hypothesis, Selector


def without_small(judge: Selector, current: Hypothesis) -> tuple[Hypothesis, tuple[str, ...]]:
    """The hypothesis without small effects beyond the second effect, and the names of these effects if together they explain much.

    Several small effects together fit almost any error, and so many causes at once are unlikely. Very small ones only correct errors of
    the others' maps. An effect is small if it explains little of what all effects explain, little of what they leave, noise included,
    and, as the third, little of the error that neighbours still share: beside a constant of centimetres, a curve of millimetres may
    still halve the rest. A wrong lens explains little, since the lens within the stated calibration absorbs it; it stays if that lens
    would otherwise contradict its calibration. So does any effect without which hand-eye would contradict its own, and late stamps without
    which arm errors would contradict the robot. Motion explains most
    at edges, where nothing is fitted: it is judged there, once the solution is closed (`conclude`).
    """
    whole, small = current, list[str]()
    while len(names := _names(judge, current)) > judge.config.named_freely:
        lost = {
            name: max(judge.score(judge.design.without(current.members, name), current.inflate).score - current.score, 0.0)
            for name in names
        }
        others = [i for i, m in enumerate(current.members) if judge.design.candidates[m].name not in names]
        beside = float(worth(judge, current)[0][others].clip(0.0).sum()) if others else 0.0
        apart = [name for name in names if not _needed(judge, name, current)]
        if not apart:
            break
        least = min(apart, key=lost.__getitem__)
        rest = judge.design.without(current.members, least)
        if lost[least] >= min(judge.config.small_share * (sum(lost.values()) + beside), judge.config.small_left * current.score):
            break
        third = len(names) == judge.config.named_freely + 1  # More of them leave nothing of any error.
        if third and takes(judge, current.members, rest) > judge.config.small_shared:
            break
        small.append(least)
        current = rescored(judge, rest)
    if not set(small) - {judge.design.candidates[m].name for m in current.members}:
        return whole, ()  # The same effect on a second part is no further cause.
    without = judge.score(current.members, whole.inflate).score - whole.score
    explained = judge.score((), whole.inflate).score - whole.score
    much = without > judge.config.small_together * explained
    return current, tuple(small) if much and visible_m(judge, whole, without) > judge.config.least_mm * 1e-3 else ()


def _needed(judge: Selector, name: str, current: Hypothesis) -> bool:
    """Whether lens, hand-eye or robot would contradict what is known of them without the effect `name`."""
    return judge.needed_by_calibration(name, current) or judge.needed_by_mount(name, current) or judge.needed_by_robot(name, current)


def takes(judge: Selector, members: Sequence[int], without: Sequence[int]) -> float:
    """Share of the variance of means, noise and errors that neighbours share, beside the members `without` that all `members` do not leave.

    The variance is that of `Selector.inflation`, in units of the noise: where no such error is left, an effect takes nothing.
    """
    return max(1.0 - judge.inflation(members) / judge.inflation(without), 0.0)


def _names(judge: Selector, current: Hypothesis) -> list[str]:
    """Names of the effects, each once, without hand-eye, whose evidence is in the arm errors, and motion, whose evidence is at edges."""
    own = {judge.design.candidates[m].name for m in current.members if not judge.is_free(m) and not judge.frees_hand([m])}
    return sorted(own - {Motion.NAME})
