# SPDX-License-Identifier: Apache-2.0
"""Ten minutes of the whole graph at the camera's rate; an hour, and the highest rate: `python -m benchmarks.soak`."""

from __future__ import annotations

from typing import TYPE_CHECKING

from benchmarks.recorded import recorded
from benchmarks.soak import SESSION, rows, stretch

if TYPE_CHECKING:
    from benchmarks.figure import Figure

LONG = True
MINUTES, HZ = 10.0, 15.0


def run() -> list[Figure]:
    """Frames lost, growth of memory, latency."""
    scene = "body_section"
    return rows(stretch(scene, recorded(scene, SESSION).bag, HZ, 60 * MINUTES, say=True), MINUTES)
