# SPDX-License-Identifier: Apache-2.0
"""The gap check's score table as figures, from what `python -m benchmarks.gap_check --form long` left; it goes on where that stopped."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from benchmarks.figure import Figure
from benchmarks.gap_check.cases import draw
from benchmarks.gap_check.examine import examine_all
from benchmarks.gap_check.record import record_all
from benchmarks.gap_check.score import Row, score_all
from benchmarks.gap_check.table import wilson
from tof_scene.builtin import builtin_names

if TYPE_CHECKING:
    from collections.abc import Callable

LONG = True
OUT, COUNT, SEED = Path("out/gap-check-long"), 500, 22

Test: TypeAlias = "Callable[[Row], bool]"
SHARES: dict[str, tuple[Test, Test, float, bool]] = {
    "gap check: one effect of usual strength named": (lambda r: r.kind == "single-usual", lambda r: r.hit, 95.0, False),
    "gap check: both of a pair named": (lambda r: r.kind == "pair", lambda r: r.hit, 85.0, False),
    "gap check: nulls are none": (lambda r: r.kind == "null", lambda r: r.hit, 97.0, False),
    "gap check: effect withheld from the list is unknown": (
        lambda r: r.kind == "left-out" and bool(r.separable),
        lambda r: r.hit,
        85.0,
        False,
    ),
    "gap check: false unknown": (lambda r: r.kind != "left-out", lambda r: "unknown" in r.verdict, 5.0, True),
}
"""What: which rows, what counts, the bar in per cent, whether the bar is an upper one."""


def run() -> list[Figure]:
    """Record and diagnose what is not there yet (hours), score all."""
    record_all(draw(COUNT, tuple(builtin_names()), SEED), OUT, (224, 171))
    examine_all(OUT)
    return figures(score_all(OUT))


def figures(rows: list[Row]) -> list[Figure]:
    """Shares with Wilson's interval in the remark."""
    out = []
    for what, (chosen, good, bar, upper) in SHARES.items():
        hits = [good(r) for r in rows if chosen(r)]
        share = 100.0 * sum(hits) / max(len(hits), 1)
        low, high = wilson(sum(hits), len(hits))
        met = share <= bar if upper else share >= bar
        remark = f"{sum(hits)} of {len(hits)}, 95 % interval {100 * low:.0f} to {100 * high:.0f} %"
        out.append(Figure(what, share, "%", f"at {'most' if upper else 'least'} {bar:g} %", met, remark=remark))
    return out
