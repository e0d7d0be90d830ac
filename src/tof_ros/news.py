# SPDX-License-Identifier: Apache-2.0
"""What is worth a line in the log: a cause that lasts is logged once, not again with every frame."""

from __future__ import annotations

import re
import time

QUIET_S = 5.0
"""Shortest time between two lines of one cause, where it comes and goes."""


class News:
    """The causes that were logged, each with its time and the number of frames that were kept by then.

    A cause is logged again after `QUIET_S` if frames were kept in between: until then nothing has changed. Two lines that differ in their
    numbers alone (stamps, milliseconds) are of one cause.
    """

    def __init__(self) -> None:
        """Nothing was logged yet."""
        self._logged: dict[str, tuple[float, int]] = {}

    def worth(self, line: str, kept: int) -> bool:
        """Whether to log this line now, `kept` frames having been kept so far; it then counts as logged."""
        cause, now = re.sub(r"\d+", "", line), time.monotonic()
        before = self._logged.get(cause)
        if before is not None and (kept == before[1] or now - before[0] < QUIET_S):
            return False
        self._logged[cause] = now, kept
        return True
