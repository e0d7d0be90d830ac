# SPDX-License-Identifier: Apache-2.0
"""A clock that was set back, told by the stamps alone."""

from __future__ import annotations

JUMP_NS = 1_000_000_000
JUMP_FRAMES = 3
"""So many frames in a row, rising, all older than what was given out by more than a second: the clock was set back."""


class BackwardJump:
    """Watches frames that come too late: one is late, several that rise among themselves belong to another time."""

    def __init__(self) -> None:
        """Nothing late yet."""
        self._late: list[int] = []

    def late(self, stamp_ns: int, newest_ns: int) -> None:
        """A frame came after a newer one had been given out."""
        if stamp_ns < newest_ns - JUMP_NS:
            rising = not self._late or stamp_ns > self._late[-1]
            self._late = [*self._late, stamp_ns] if rising else [stamp_ns]

    def clear(self) -> None:
        """A frame came in order."""
        self._late.clear()

    def __bool__(self) -> bool:
        """Whether the clock was set back."""
        return len(self._late) >= JUMP_FRAMES
