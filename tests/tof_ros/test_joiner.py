# SPDX-License-Identifier: Apache-2.0
"""Joining topics by stamp: order, patience, what is lost is counted."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from tof_ros.joiner import StampJoiner


def take(joiner: StampJoiner, *, force: bool = False) -> list[tuple[int, str]]:
    return [(stamp, "".join(sorted(parts))) for stamp, parts in joiner.take(force=force)]


def test_a_set_leaves_when_it_has_all_parts_in_whatever_order_they_come() -> None:
    joiner = StampJoiner("ab")
    joiner.add("b", 1, None)
    assert take(joiner) == []
    joiner.add("a", 1, None)
    assert take(joiner) == [(1, "ab")]
    assert take(joiner) == []


def test_an_expected_part_is_waited_for_until_a_newer_set_is_whole() -> None:
    joiner = StampJoiner("a", expected="x", patience_s=60)
    joiner.add("a", 1, None)
    assert take(joiner) == []
    joiner.add("a", 2, None)
    joiner.add("x", 2, None)
    assert take(joiner) == [(1, "a"), (2, "ax")]
    assert joiner.incomplete == 0


def test_an_expected_part_is_not_waited_for_longer_than_patience() -> None:
    joiner = StampJoiner("a", expected="x", patience_s=0)
    joiner.add("a", 1, None)
    assert take(joiner) == [(1, "a")]


def test_a_set_that_is_overdue_waits_no_longer_whatever_the_clock_says() -> None:
    joiner = StampJoiner("a", expected="x", patience_s=float("inf"))
    joiner.add("a", 1, None)
    joiner.add("x", 2, None)
    joiner.add("a", 3, None)
    assert take(joiner) == []
    assert list(joiner.take(overdue=2)) == [(1, {"a": None})]
    assert joiner.incomplete == 0
    assert list(joiner.take(overdue=3)) == [(3, {"a": None})]


def test_a_set_without_a_required_part_is_dropped_and_counted() -> None:
    joiner = StampJoiner("ab", patience_s=60)
    joiner.add("a", 1, None)
    joiner.add("a", 2, None)
    joiner.add("b", 2, None)
    assert take(joiner) == [(2, "ab")]
    assert joiner.incomplete == 1


def test_a_part_older_than_what_was_given_out_is_late() -> None:
    joiner = StampJoiner("a")
    joiner.add("a", 5, None)
    assert take(joiner) == [(5, "a")]
    joiner.add("a", 4, None)
    assert take(joiner, force=True) == []
    assert joiner.late == 1


def test_after_clear_older_stamps_count_again() -> None:
    joiner = StampJoiner("a")
    joiner.add("a", 5, None)
    assert take(joiner) == [(5, "a")]
    joiner.clear()
    joiner.add("a", 4, None)
    assert take(joiner) == [(4, "a")]


def test_memory_is_bounded() -> None:
    joiner = StampJoiner("ab", patience_s=60, limit=10)
    for stamp in range(1000):
        joiner.add("a", stamp, None)
        assert take(joiner) == []
    assert joiner.incomplete == 990


@given(st.permutations([(part, stamp) for part in "abx" for stamp in range(4)]))
def test_every_whole_set_comes_out_once_and_in_order_whatever_the_order_of_arrival(arrivals: list[tuple[str, int]]) -> None:
    joiner = StampJoiner("ab", expected="x", patience_s=60)
    for part, stamp in arrivals:
        joiner.add(part, stamp, (part, stamp))
    assert take(joiner) == [(stamp, "abx") for stamp in range(4)]
