# SPDX-License-Identifier: Apache-2.0
"""Mutants: which faults are made of a function, where they lie, and what a sample of them shows."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from benchmarks.mutants import Mutant, mutants, put_in_place, source_of
from benchmarks.mutate import chosen_of, interval, of_room
from benchmarks.mutated_rooms import ROOMS
from tof_core import stats

if TYPE_CHECKING:
    from pathlib import Path

SOURCE = '''
def outer(a: int = 3, *, b=5) -> float:
    """Says 7."""
    if a < 2:
        raise ValueError(a + 1)
    total: float = (
        a
        - abs(b)
    )
    def inner(c):
        return min(c, total)
    return inner(not a), zip(b, b, strict=True)

def other():
    return 1
'''


def of(source: str, *functions: str) -> list[Mutant]:
    return list(mutants("tof_core.stats", source, functions))


def test_faults_are_in_operators_conditions_constants_and_calls_but_not_in_messages_and_annotations() -> None:
    assert [(m.line, m.what) for m in of(SOURCE, "outer")] == [
        (4, "if True (for a < 2)"),
        (4, "if False (for a < 2)"),
        (4, "a <= 2"),
        (4, "a >= 2"),
        (4, "2 -> 3"),
        (4, "2 -> 4"),
        (7, "a + abs(b)"),
        (8, "no abs"),
        (11, "max for min"),
        (12, "a"),
    ]


def test_a_fault_knows_the_lines_of_its_statement() -> None:
    lines = {m.what: m.lines for m in of(SOURCE, "outer")}
    assert lines["a <= 2"] == range(4, 5), "of a condition the head alone"
    assert lines["no abs"] == range(6, 10)
    assert lines["max for min"] == range(11, 12)


def test_every_fault_is_made_once() -> None:
    assert [m.what for m in of(SOURCE, "other")] == ["1 -> 2"], "1 + 1 and 2 * 1 are the same"


def test_a_name_that_is_no_function_is_an_error() -> None:
    with pytest.raises(SystemExit, match="no functions"):
        of(SOURCE, "outer", "missing")


def test_a_fault_in_place_changes_what_callers_get(monkeypatch: pytest.MonkeyPatch) -> None:
    below = stats.pairs_below
    monkeypatch.setattr(below, "__code__", below.__code__)
    (half, *_) = of(source_of("tof_core.stats").read_text(), "pairs_below")
    assert below(np.arange(2.0), np.full(1, 1.5)) == 2.0
    put_in_place(half)
    assert half.what.startswith("0.5 / sum")
    assert below(np.arange(2.0), np.full(1, 1.5)) == 0.125


def test_every_room_has_faults_and_tests(repository: Path) -> None:
    for room in ROOMS.values():
        assert len(of_room(room)) >= 60
        assert all((repository / path.partition("::")[0]).exists() for path in room.tests)


def test_a_sample_is_repeatable_and_its_interval_is_wilsons() -> None:
    every = of_room(ROOMS["network"])
    assert chosen_of("network", every, 20) == chosen_of("network", every, 20)
    assert len(set(map(id, chosen_of("network", every, 20)))) == 20
    assert len(chosen_of("network", every, 0)) == len(every)
    assert interval(81, 90) == "82 to 95"
    assert interval(0, 0) == "0 to 100"
