# SPDX-License-Identifier: Apache-2.0
"""Effects that a session cannot distinguish, compared in two sessions: the name under which they are compared, and the tie that is stated."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from collections.abc import Set as AbstractSet

    from tof_gap.tell.account import Cause


def same_effect(real: Sequence[Cause], simulated: Sequence[Cause], named: tuple[AbstractSet[str], AbstractSet[str]]) -> dict[str, str]:
    """Simulator's name to real's: where one effect may be what both sessions show, both are compared under the real session's name.

    Args:
        real: causes of the camera's session.
        simulated: causes of the simulator's.
        named: effects that the real and the simulated session name.
    """
    taken: dict[str, str] = {}
    for cause in real:
        name = cause.named.name
        for other in simulated:
            theirs = other.named.name
            one_sided = name in named[0] - named[1] and theirs in named[1] - named[0]
            if one_sided and name not in taken.values() and theirs not in taken and _may_be(cause) & _may_be(other):
                taken[theirs] = name
    return taken


def ties(real: Sequence[Cause], simulated: Sequence[Cause], taken: Mapping[str, str]) -> dict[str, tuple[str, ...]]:
    """For each compared effect, the effects that the sessions cannot distinguish from it.

    Of an effect that both sessions name, those that neither session rules out. Where the compared name is not among them, all that
    either session holds possible.
    """
    possible: dict[str, list[set[str]]] = {}
    for side, causes in enumerate((real, simulated)):
        for cause in causes:
            name = cause.named.name
            possible.setdefault(taken.get(name, name) if side else name, []).append(_may_be(cause))
    out = {}
    for name, sets in possible.items():
        common = set.intersection(*sets)
        out[name] = tuple(sorted((common if name in common else set.union(*sets)) - {name}))
    return out


def _may_be(cause: Cause) -> set[str]:
    return {cause.named.name, *cause.named.ties}
