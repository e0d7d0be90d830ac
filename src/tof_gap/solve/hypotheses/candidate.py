# SPDX-License-Identifier: Apache-2.0
"""One hypothesis of a session."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from tof_sensor.effects.hand_eye import HandEye

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_gap.solve.hypotheses.nameless import Nameless
    from tof_sensor.effect import Effect

HAND_EYE = HandEye.NAME
"""X of the pose chain. It has no columns: the system frees X instead."""


@dataclass(frozen=True, slots=True)
class Candidate:
    """One hypothesis: an effect in one form, or an error of no named effect, as a free function of one observable is.

    `effect` is None for hand-eye, which is part of the pose chain, and for an error without a name; further: as in `Form`.
    """

    name: str
    effect: Effect | None
    note: str = ""
    free: Nameless | None = None
    further: bool = False

    @property
    def source(self) -> Effect | Nameless | None:
        """What its columns are computed from."""
        return self.free if self.effect is None else self.effect

    def excludes(self, other: Candidate) -> bool:
        """Whether no hypothesis may contain both: two forms of an effect that a session, or a part, has only once, or a stated rival."""
        if self.name != other.name:
            return self._rivals(other) or other._rivals(self)
        if self.free is not None:
            return other.free is not None and self.free.quantity == other.free.quantity
        return self.effect is None or other.effect is None or not self.effect.occurs_beside(other.effect)

    def _rivals(self, other: Candidate) -> bool:
        return self.free is not None and other.name in self.free.RIVALS

    def stands_beside(self, others: Sequence[Candidate]) -> bool:
        """Whether a hypothesis may contain the candidate together with exactly the candidates `others`; it may be one of them."""
        if not self.further:
            return True
        straight = any(o.effect is not None and o.effect.STRAIGHT for o in others)
        return not straight and any(o.name == self.name and not o.further for o in others)
