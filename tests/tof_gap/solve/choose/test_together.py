# SPDX-License-Identifier: Apache-2.0
"""Selection in two sessions together on scores that are given: what one session shows beside the members of both is added."""

from __future__ import annotations

from typing import Any

import pytest

from tests.tof_gap.scored import NOTHING, Judge
from tof_gap.solve.choose import select as room
from tof_gap.solve.choose.together import added


@pytest.fixture(autouse=True)
def no_maps(monkeypatch: pytest.MonkeyPatch) -> None:
    """What maps could absorb needs columns, which these judges have not."""
    monkeypatch.setattr(room, "_absorbable", lambda *_: 0.0)
    monkeypatch.setattr(room, "_along", lambda *_: 0.0)


def chosen(one: dict[str, float], other: dict[str, float], begun: str = "", **more: Any) -> str:
    judges: list[Any] = [Judge(one, **more), Judge(other, **more)]
    letters = judges[0].letters
    return "".join(letters[i] for i in added(judges, [letters.index(letter) for letter in begun]))


def test_an_effect_that_one_session_shows_is_added_and_the_other_need_not_have_it() -> None:
    assert chosen({"a": NOTHING + 6.0}, {"a": 900.0}) == "a"
    assert chosen({"a": NOTHING + 6.0}, {"a": NOTHING - 35.0}) == "", "29 of both together are less than the 30 that an effect must win"


def test_what_only_both_sessions_together_show_is_no_effect_of_either() -> None:
    assert chosen({"a": NOTHING - 25.0}, {"a": NOTHING - 25.0}) == ""
    assert chosen({"a": NOTHING - 25.0}, {"a": NOTHING - 31.0}) == "a"


def test_members_from_the_start_stay_and_an_effect_that_they_hid_is_found() -> None:
    """An offset (a) and a drift (b) cancel: neither explains anything alone, both explain much."""
    hidden = {"a": NOTHING, "b": NOTHING, "ab": 850.0}
    plain = {"a": 700.0, "b": NOTHING + 3.0, "ab": 703.0}
    assert chosen(plain, hidden, "a") == "b"
    assert chosen(plain, plain, "a") == ""
    assert chosen({"a": NOTHING}, {"a": NOTHING}, "a") == "", "the start stays, also where it explains nothing"


def test_an_added_effect_gives_way_to_one_that_explains_more_in_its_place() -> None:
    """c wins most alone; once b is there, a does better than c."""
    scores = {"a": 960.0, "b": 950.0, "c": 940.0, "ab": 700.0, "ac": 930.0, "bc": 850.0, "abc": 699.0}
    assert chosen(scores, scores) == "ab"


def test_coefficients_must_be_possible_in_the_session_that_wins_most() -> None:
    assert chosen({"a": 900.0}, {"a": 950.0}, implausible=("a",)) == ""
