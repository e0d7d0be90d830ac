# SPDX-License-Identifier: Apache-2.0
"""Views that a busy node never took: its queue holds the newest messages, and DDS says nothing of those that it pushed out."""

from __future__ import annotations

import time
from collections import deque
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

OVERRUN = "overrun"
"""Why a view has no outputs: some of its messages, or all, were pushed out of the node's queue."""
RECENT_S = 10.0
"""So long a loss is a warning: a node that is behind loses views every second or two."""
GAPS = 64
"""Gaps of a topic that are kept: more views do not wait for their parts."""


class Numbered:
    """The messages of one topic in the numbers of their publisher: a number that is left out was pushed out of the queue."""

    def __init__(self, publishers: Callable[[], int]) -> None:
        """Nothing was taken. `publishers`: how many the topic has; each has numbers of its own, so of two nothing is known."""
        self._publishers = publishers
        self._number: int | None = None
        self._stamp = 0
        self._gaps: deque[tuple[int, int]] = deque(maxlen=GAPS)

    def take(self, number: int | None, stamp: int) -> int:
        """How many messages are missing before this one; `number` is None where the middleware has none, and restarts with the publisher."""
        missing = 0 if number is None or self._number is None else max(number - self._number - 1, 0)
        if missing and self._publishers() != 1:
            missing = 0
        if missing:
            self._gaps.append((self._stamp, stamp))
        self._number, self._stamp = number, stamp
        return missing

    def lacks(self, stamp: int) -> bool:
        """Whether the message of a stamp is one of the missing ones."""
        return any(before < stamp < after for before, after in self._gaps)


class Overrun:
    """What was lost so, for the diagnostics."""

    def __init__(self, queue: int, relief: str) -> None:
        """`queue`: messages that a queue holds; `relief`: what to do, as one sentence."""
        self._queue, self._relief = queue, relief
        self._lost: deque[tuple[float, int]] = deque()
        self._total, self._waited_s = 0, 0.0

    def lose(self, views: int, waited_s: float) -> None:
        """Views are lost; the one after them has waited so long in the queue, 0 where that is not known."""
        self._lost.append((time.monotonic(), views))
        self._total += views
        self._waited_s = max(waited_s, self._waited_s if len(self._lost) > 1 else 0.0)

    def warning(self) -> list[str]:
        """One line while views are being lost."""
        while self._lost and self._lost[0][0] < time.monotonic() - RECENT_S:
            self._lost.popleft()
        if not self._lost:
            return []
        recent = sum(views for _, views in self._lost)
        counts = f"{recent} lost in the last {RECENT_S:.0f} s, {self._total} in all"
        queue = f"pushed out of its queue of {self._queue}, in which others waited {self._waited_s:.1f} s"
        return [f"views come faster than this node takes them: {counts}, {queue}. {self._relief}"]


def waited_s(info: Mapping[str, Any]) -> float:
    """Seconds from the arrival of a message in this process until now; `info` as rclpy gives it."""
    return max((time.time_ns() - int(info.get("received_timestamp") or time.time_ns())) * 1e-9, 0.0)
