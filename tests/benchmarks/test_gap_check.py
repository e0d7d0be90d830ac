# SPDX-License-Identifier: Apache-2.0
"""The short form of the gap check: forty sessions whose effect is withheld, compared with the bars of docs/gap_check.md as far as forty sessions allow."""

from __future__ import annotations

import hashlib
from collections import Counter
from typing import TYPE_CHECKING

import pytest

from benchmarks.gap_check import __main__ as gap_check
from benchmarks.gap_check.cases import draw
from benchmarks.gap_check.examine import examine_all
from benchmarks.gap_check.record import record_all
from benchmarks.gap_check.score import Row, score_all
from benchmarks.gap_check.table import misses, wilson
from tof_scene.builtin import builtin_names

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

SEED = 40
pytestmark = [pytest.mark.slow, pytest.mark.timeout(3600)]


def digest(folders: list[Path]) -> str:
    """Of all sources in some folders: what was made by other code is not gone on with."""
    h = hashlib.sha256()
    for path in sorted(p for f in folders for p in f.rglob("*.py")):
        h.update(path.read_bytes())
    return h.hexdigest()[:16]


@pytest.fixture(scope="module")
def rows(request: pytest.FixtureRequest, repository: Path) -> list[Row]:
    """The scored cases; stopped and started again, the fixture goes on where it was."""
    assert request.config.cache is not None
    sources = [*sorted((repository / "src").glob("tof_*")), repository / "src" / "toftwin", repository / "benchmarks" / "gap_check"]
    out = request.config.cache.mkdir("gap-check") / digest(sources)
    count, size = gap_check.FORMS["short"]
    width, height = (int(x) for x in size.split("x"))
    record_all(draw(count, tuple(builtin_names()), SEED), out, (width, height))
    examine_all(out)
    return score_all(out)


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
    assert within_reach(hits, bar), "\n".join([f"{what}: {sum(hits)} of {len(hits)}", *misses(rows)])
