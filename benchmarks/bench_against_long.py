# SPDX-License-Identifier: Apache-2.0
"""`toftwin gap REAL --against SIMULATED` on pairs of sessions of the emerging camera, whose difference the generator knows."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from benchmarks.figure import Figure, at_least

if TYPE_CHECKING:
    from collections.abc import Sequence

    from benchmarks.against.score import PairRow

LONG = True
PAIRS, SEED, SIZE = 24, 59, (160, 122)
"""Pairs of seeds 45 to 59 are seen: each was judged once, and showed what had to be corrected."""
OUT = Path(f"out/bench/against-{SEED}")
NAMED_BAR, RIGHT_BAR = 85.0, 97.0


def run() -> list[Figure]:
    """Share of pairs of each kind whose difference is named, rightly and alone; of right simulators that differ in nothing."""
    from benchmarks.against.compare import compare_pairs
    from benchmarks.against.pairs import RIGHT, SIMULATORS, draw_pairs
    from benchmarks.against.record import record_pairs
    from benchmarks.against.score import score_pairs

    record_pairs(draw_pairs(PAIRS, SEED), OUT, SIZE)
    compare_pairs(OUT)
    rows = score_pairs(OUT)
    for row in rows:
        print(row.line, flush=True)
    return [
        _share(kind, [r for r in rows if r.kind == kind and r.counts], RIGHT_BAR if kind == RIGHT else NAMED_BAR) for kind in SIMULATORS
    ]


def _share(kind: str, rows: Sequence[PairRow], bar: float) -> Figure:
    from benchmarks.gap_check.table import wilson

    hits, seen = sum(r.hit for r in rows), sum(r.seen for r in rows)
    low, high = wilson(hits, len(rows))
    missed = "; ".join(r.line for r in rows if not r.hit) or "none"
    remark = f"{hits} of {len(rows)} ({100 * low:.0f} to {100 * high:.0f} %); effect named in any manner: {seen}; misses: {missed}"
    what = {
        "right": "a right simulator differs in nothing",
        "missing": "an effect that the simulator lacks is named, and nothing else",
        "twice": "an effect that the simulator has at twice its size is named, and nothing else",
        "superfluous": "an effect that reality has not is named, and nothing else",
    }[kind]
    return at_least(f"simulator against camera: {what}", 100 * hits / len(rows) if rows else float("nan"), bar, "%", remark=remark)
