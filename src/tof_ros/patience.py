# SPDX-License-Identifier: Apache-2.0
"""Waiting time of frames for their missing parts, counted in the node's own cycles."""

from __future__ import annotations

PERIOD_S = 0.1
NEVER = -(2**62)
ALWAYS = 2**62


class Patience:
    """Ages of waiting frames, in ticks of a timer.

    A timer does not tick while its node is busy, so a node that was held up (compiling, labelling, a
    loaded machine) still takes what lies in its queues before it gives a frame up.
    """

    def __init__(self, seconds: float) -> None:
        """Frames wait at least so long."""
        self._most = max(round(seconds / PERIOD_S), 2)
        self._ages: dict[int, int] = {}

    def __bool__(self) -> bool:
        """Whether a frame waits."""
        return bool(self._ages)

    def start(self, stamp_ns: int) -> None:
        """A frame begins to wait."""
        self._ages.setdefault(stamp_ns, 0)

    def end(self, stamp_ns: int) -> None:
        """A frame waits no longer."""
        self._ages.pop(stamp_ns, None)

    @property
    def oldest(self) -> int:
        """The first stamp that waits, `ALWAYS` where none does; other threads may ask."""
        return min(tuple(self._ages), default=ALWAYS)

    def clear(self) -> None:
        """No frame waits."""
        self._ages.clear()

    def tick(self) -> int:
        """One period has passed; the newest stamp that has waited long enough, or `NEVER`."""
        self._ages = {stamp: age + 1 for stamp, age in self._ages.items()}
        return max((stamp for stamp, age in self._ages.items() if age >= self._most), default=NEVER)
