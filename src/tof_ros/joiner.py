# SPDX-License-Identifier: Apache-2.0
"""Joins messages of several topics that carry one stamp, in order of stamps, within bounded memory."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator


class StampJoiner:
    """Sets of parts by stamp.

    A set is whole when it has all `required` parts and all `expected` ones. A set that has the
    required parts alone is given out once a newer one is whole or it has waited `patience_s`;
    one that lacks a required part is then dropped and counted in `incomplete`; `on_incomplete` receives its stamp and the parts that it lacks.
    """

    def __init__(self, required: Iterable[str], expected: Iterable[str] = (), *, patience_s: float = 0.25, limit: int = 64) -> None:
        """At most `limit` sets wait at a time."""
        self.on_incomplete: Callable[[int, frozenset[str]], None] = lambda _, __: None
        self._required, self._expected = frozenset(required), set(expected)
        self._patience_s, self._limit = patience_s, limit
        self._sets: dict[int, dict[str, Any]] = {}
        self._born: dict[int, float] = {}
        self.newest = -1
        self.incomplete = self.late = 0

    def expect(self, part: str) -> None:
        """From now on wait for this part too."""
        self._expected.add(part)

    def add(self, part: str, stamp_ns: int, value: Any) -> bool:
        """Put a part in its set; a part older than what was given out is late and forgotten (false)."""
        if stamp_ns <= self.newest:
            self.late += part in self._required
            return False
        self._sets.setdefault(stamp_ns, {})[part] = value
        self._born.setdefault(stamp_ns, time.monotonic())
        return True

    def take(self, *, force: bool = False, overdue: int = -1) -> Iterator[tuple[int, dict[str, Any]]]:
        """Sets that are ready, oldest first; those up to the stamp `overdue` wait no longer; `force` gives all that have their required parts."""
        for stamp in sorted(self._sets)[: self._due(overdue, force=force)]:
            parts = self._sets.pop(stamp)
            del self._born[stamp]
            self.newest = stamp
            if self._required <= parts.keys():
                yield stamp, parts
            elif self._required & parts.keys():
                self.incomplete += 1
                self.on_incomplete(stamp, self._required - parts.keys())

    def _due(self, overdue: int, *, force: bool) -> int:
        """How many of the oldest sets leave now."""
        stamps = sorted(self._sets)
        if force:
            return len(stamps)
        wanted = self._required | self._expected
        old = time.monotonic() - self._patience_s
        leaving = [i for i, s in enumerate(stamps) if wanted <= self._sets[s].keys() or self._born[s] < old or s <= overdue]
        return max([i + 1 for i in leaving] + [len(stamps) - self._limit, 0])

    def clear(self) -> None:
        """Forget everything: the clock jumped or the user asked."""
        self._sets.clear()
        self._born.clear()
        self.newest = -1
