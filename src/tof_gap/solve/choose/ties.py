# SPDX-License-Identifier: Apache-2.0
"""Ties: effects that the session cannot distinguish."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tof_gap.solve.choose.worth import coefficients

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_gap.solve.choose.judge import Hypothesis, Selector
    from tof_sensor.effect import Effect


FREE_FROM = 12
"""Coefficients from which a form describes whatever a formula does; formulas have up to eight (a lens)."""


def stand_ins(judge: Selector, current: Hypothesis, place: int) -> tuple[int, ...]:
    """Candidates with other names that the data cannot distinguish from the member at `place`.

    A field over the image or a curve is no rival of a formula that explains as much: what a lamp beside the lens does in two coefficients,
    sixteen of a smooth field do as well, and would do of any other cause.
    """
    d, config = judge.design, judge.config
    member = current.members[place]
    rest = [m for i, m in enumerate(current.members) if i != place]
    taken = {d.candidates[m].name for m in current.members}
    found: dict[str, tuple[float, int]] = {}
    standing_in = judge.beside(rest, place, current.inflate)
    for i, candidate in enumerate(d.candidates):
        if candidate.name in taken or judge.is_free(i) or _contains(candidate.effect, d.candidates[member].name):
            continue
        if len(d.groups[i]) >= FREE_FROM > len(d.groups[member]):
            continue
        trial = standing_in(i)
        if trial.score - current.score > config.tie_gain or not judge.plausible(trial):
            continue
        if judge.needed_by_calibration(d.candidates[member].name, trial):
            continue  # Hand-eye or lens would still be farther off than calibration.yaml states.
        if not _hides(judge, current, place, member, i, rest):
            continue
        if candidate.name not in found or trial.score < found[candidate.name][0]:
            found[candidate.name] = (trial.score, i)
    return tuple(i for _, i in sorted(found.values()))


def _contains(effect: Effect | None, name: str) -> bool:
    """Whether the effect without its own terms is the effect `name`: it always explains at least as much."""
    return effect is not None and name == effect.rest


def _hides(judge: Selector, current: Hypothesis, place: int, member: int, other: int, rest: Sequence[int]) -> bool:
    """Whether `other`, with the poses and the rest, leaves little of the member's map; for hand-eye, which has none, little to win."""
    design = judge.design
    if judge.frees_hand([member, other]):
        beside = judge.score([*rest, other], current.inflate).score - judge.score([*rest, other, member], current.inflate).score
        return beside < judge.gain(member)
    theta = coefficients(judge, current, judge.fit(current), place)
    target = design.groups[member]
    before, after = (design.system.left_of(target, theta, judge.columns(c), inflate=current.inflate) for c in (rest, [*rest, other]))
    return after < judge.config.tie_left * max(before, 1e-12)
