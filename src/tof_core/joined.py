# SPDX-License-Identifier: Apache-2.0
"""Messages kept by stamp until they are joined with a depth image."""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass
from typing import Any

from tof_core.decode import stamp_ns


@dataclass(frozen=True, slots=True, eq=False)
class Joined:
    """Messages waiting to join a depth image: stamps ascending beside their messages."""

    stamps: list[int]
    messages: list[Any]

    def put(self, msg: Any) -> None:
        """Insert a message; of two with one stamp the first stays."""
        stamp = stamp_ns(msg)
        i = bisect_right(self.stamps, stamp)
        if i == 0 or self.stamps[i - 1] != stamp:
            self.stamps.insert(i, stamp)
            self.messages.insert(i, msg)

    def nearest(self, stamp: int, within_ns: int) -> Any | None:
        """The message nearest to a stamp; the earlier of two at equal distance."""
        i = bisect_right(self.stamps, stamp)
        near = [j for j in (i - 1, i) if 0 <= j < len(self.stamps)]
        best = min(near, key=lambda j: abs(self.stamps[j] - stamp), default=-1)
        return self.messages[best] if best >= 0 and abs(self.stamps[best] - stamp) <= within_ns else None

    def settled(self, stamp: int) -> bool:
        """Whether no later message can be nearer: a stamp is equal or later."""
        return bool(self.stamps) and self.stamps[-1] >= stamp

    def forget_before(self, stamp: int) -> None:
        """Drop messages older than `stamp`, but keep the last of them."""
        old = bisect_right(self.stamps, stamp) - 1
        if old > 0:
            del self.stamps[:old]
            del self.messages[:old]
