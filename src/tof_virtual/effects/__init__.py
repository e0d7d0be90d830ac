# SPDX-License-Identifier: Apache-2.0
"""The effects of the vocabulary, as physics of the virtual camera and robot."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tof_core.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from tof_virtual.config import VirtualConfig
    from tof_virtual.effects.base import Effect

EFFECTS: dict[str, type[Effect]] = {}
"""By name, in the order in which they act."""


def make_effects(strengths: Mapping[str, float], config: VirtualConfig) -> tuple[Effect, ...]:
    """Effects of these strengths (zero is off), in the order in which they act."""
    unknown = sorted(set(strengths) - set(EFFECTS))
    if unknown:
        msg = f"effect '{unknown[0]}' is not known"
        raise UsageError(msg, where="--effect", todo=f"use one of {', '.join(EFFECTS)}")
    wrong = [f"{n}={s:g}" for n, s in strengths.items() if not 0 <= s <= 100]
    if wrong:
        msg = f"strength {wrong[0]} is out of bounds"
        raise UsageError(msg, where="--effect", todo="0 is off, 1 usual, 0.33 small, 3.3 large")
    return tuple(EFFECTS[n](strengths[n], config) for n in EFFECTS if strengths.get(n, 0) > 0)
