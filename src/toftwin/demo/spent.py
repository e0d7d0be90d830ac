# SPDX-License-Identifier: Apache-2.0
"""Time of the demonstration's steps: on the clock, and of the processors, which other programs on the host do not change."""

from __future__ import annotations

import os
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable


@dataclass(frozen=True, slots=True)
class Spent:
    """Duration of a step, and processor time of all its processes, in seconds."""

    seconds: float
    processor: float


def measured(work: Callable[..., Any], *args: Any) -> tuple[Any, Spent]:
    """The result of a function, and the time that it took in this process."""
    began, before = time.monotonic(), processor_seconds()
    result = work(*args)
    return result, Spent(time.monotonic() - began, processor_seconds() - before)


def processor_seconds() -> float:
    """Processor time of this process and of its children that have ended, in seconds."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system
