# SPDX-License-Identifier: Apache-2.0
"""One hypothesis of a session."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Protocol

from tof_sensor.effects.amplitude_bias import AmplitudeBias
from tof_sensor.effects.hand_eye import HandEye

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Float
    from tof_gap.seen.residual import ViewEvidence
    from tof_sensor.effect import Effect

HAND_EYE = HandEye.NAME
"""X of the pose chain. It has no columns: the system frees X instead."""


class Nameless(Protocol):
    """An error of no named effect that depends on the observable `quantity`; `FORMULA` tells a formula from a function that fits any error."""

    FORMULA: ClassVar[bool]

    @property
    def quantity(self) -> str:
        """The observable."""

    def columns(self, view: ViewEvidence) -> Float:
        """(n, k) at a view's drawn pixels: metres of z per metre along the ray."""

    def share(self, values: Float, view: ViewEvidence) -> Float:
        """(H, W) metres of z for `values` (k,)."""


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
        """Whether no hypothesis may contain both: two forms of an effect that a session, or a part, has only once, or two formulas of amplitude."""
        if self.name != other.name:
            return self._rivals(other) or other._rivals(self)
        if self.free is not None:
            return other.free is not None and self.free.quantity == other.free.quantity
        return self.effect is None or other.effect is None or not self.effect.occurs_beside(other.effect)

    def _rivals(self, other: Candidate) -> bool:
        """Whether a formula without a name would explain what formulas of `amplitude_bias` leave of it: both go as the inverse of amplitude."""
        return self.free is not None and self.free.FORMULA and other.name == AmplitudeBias.NAME

    def stands_beside(self, others: Sequence[Candidate]) -> bool:
        """Whether a hypothesis may contain the candidate together with exactly the candidates `others`; it may be one of them."""
        if not self.further:
            return True
        straight = any(o.effect is not None and o.effect.STRAIGHT for o in others)
        return not straight and any(o.name == self.name and not o.further for o in others)
