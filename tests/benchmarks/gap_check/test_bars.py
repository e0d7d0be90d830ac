# SPDX-License-Identifier: Apache-2.0
"""The short form of the gap check: forty sessions whose effect is withheld, compared with the bars of docs/gap_check.md as far as forty sessions allow."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

import pytest

from benchmarks.gap_check.table import misses, wilson
from tests.benchmarks.gap_check.short_form import COUNT, folder_of, scored

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from benchmarks.gap_check.score import Row

pytestmark = [pytest.mark.slow, pytest.mark.timeout(3600)]


@pytest.fixture(scope="module")
def rows(request: pytest.FixtureRequest, repository: Path) -> list[Row]:
    """The scored cases. Last first: a process that still makes cases in their order is met once, not at every case."""
    folder = folder_of(request.config, repository)
    return [scored(folder, number) for number in reversed(range(COUNT))][::-1]


def within_reach(hits: list[bool], bar: float) -> bool:
    """Whether so many hits leave the bar inside Wilson's 99 % interval: eight bars are asked of forty sessions."""
    return wilson(sum(hits), len(hits), z=2.576)[1] >= bar


def test_every_kind_is_there(rows: list[Row]) -> None:
    kinds = Counter(r.kind for r in rows)
    assert len(rows) == 40
    assert kinds["null"] == 16
    assert min(kinds[k] for k in ("single-usual", "single-small", "single-large", "pair", "left-out")) >= 3


@pytest.mark.parametrize(
    ("what", "chosen", "good", "bar"),
    [
        ("one effect of usual strength is named", lambda r: r.kind == "single-usual", lambda r: r.hit, 0.95),
        ("both of a pair are named", lambda r: r.kind == "pair", lambda r: r.hit, 0.85),
        ("nulls are none", lambda r: r.kind == "null", lambda r: r.hit, 0.97),
        ("a withheld effect is unknown", lambda r: r.kind == "left-out" and r.separable, lambda r: r.hit, 0.85),
        ("no false unknown", lambda r: r.kind != "left-out", lambda r: "unknown" not in r.verdict, 0.95),
        ("the place of localised effects is found", lambda r: r.kind != "left-out" and r.place is not None, lambda r: r.place > 0.9, 0.8),
        ("the map of effects everywhere is theirs", lambda r: r.likeness is not None, lambda r: r.likeness > 0.9, 0.8),
        ("what was named leaves the floor", lambda r: r.left_over_floor is not None, lambda r: r.left_over_floor <= 1.2, 0.9),
    ],
)
def test_bars(rows: list[Row], what: str, chosen: Callable[[Row], bool], good: Callable[[Row], bool], bar: float) -> None:
    hits = [good(r) for r in rows if chosen(r)]
    assert not within_reach([False] * len(hits), bar), f"{len(hits)} sessions cannot miss this bar"
    assert within_reach(hits, bar), "\n".join([f"{what}: {sum(hits)} of {len(hits)}", *misses(rows)])
