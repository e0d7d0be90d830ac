# SPDX-License-Identifier: Apache-2.0
"""Detection of a clock that was set back, from header stamps alone."""

from __future__ import annotations

JUMP_NS = 1_000_000_000
JUMP_FRAMES = 3
"""The clock was set back if this many frames in a row have ascending stamps and are all older than the newest output by more than `JUMP_NS`."""


class BackwardJump:
    """Counts frames that arrive too late. One such frame is late; several with ascending stamps mean that the clock was set back."""

    def __init__(self) -> None:
        """Nothing late yet."""
        self._late: list[int] = []

    def late(self, stamp_ns: int, newest_ns: int) -> None:
        """Record a frame that arrived after a newer one had been output."""
        if stamp_ns < newest_ns - JUMP_NS:
            rising = not self._late or stamp_ns > self._late[-1]
            self._late = [*self._late, stamp_ns] if rising else [stamp_ns]

    def clear(self) -> None:
        """Record a frame that arrived in order."""
        self._late.clear()

    def __bool__(self) -> bool:
        """Whether the clock was set back."""
        return len(self._late) >= JUMP_FRAMES
