# SPDX-License-Identifier: Apache-2.0
"""Ten minutes of the whole graph: one camera, five, a large one; an hour, and the highest rate: `python -m benchmarks.soak`."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from benchmarks.load import STOCK_LOAD, Load
from benchmarks.soak import rows, stretch

if TYPE_CHECKING:
    from benchmarks.figure import Figure

LONG = True
MINUTES = 10.0
LOADS = (STOCK_LOAD, Load(cameras=5), Load(30.0, 640, 576))


def run() -> list[Figure]:
    """Frames lost, growth of memory, latency."""
    figures = []
    for given in LOADS:
        command = f"python -m benchmarks.soak --minutes {MINUTES:g}{given.flags}"
        figures += [replace(figure, command=command) for figure in rows(stretch(given, 60 * MINUTES, say=True), MINUTES, given)]
    return figures
