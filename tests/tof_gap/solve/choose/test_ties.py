# SPDX-License-Identifier: Apache-2.0
"""Effects that each explain little, and effects that the session cannot tell apart, on scores that are given."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.tof_gap.scored import NOTHING, Judge, effect, hypothesis, named
from tof_gap.solve.choose import small as small_room
from tof_gap.solve.choose import ties as ties_room
from tof_gap.solve.choose.small import without_small
from tof_gap.solve.choose.ties import stand_ins


@pytest.mark.parametrize(
    ("small", "left", "kept", "told"),
    [
        (40.0, 100.0, "abc", ()),  # 40 of 840: less than 15 %, and yet more than 15 % of the 100 that are left
        (14.0, 100.0, "ab", ()),  # ... and not: but alone it is too little to be told
        (70.0, 600.0, "ab", ("c",)),
    ],
)
def test_a_third_effect_that_explains_little_is_told_where_it_is_much_of_all(
    small: float, left: float, kept: str, told: tuple[str, ...]
) -> None:
    scores = {"abc": left, "ab": left + small, "ac": left + 400.0, "bc": left + 400.0}
    judge: Any = Judge(scores, least_mm=0.1)
    found, small_ones = without_small(judge, hypothesis(judge, "abc"))
    assert named(judge, found) == kept
    assert small_ones == (told if small > 0.06 * (NOTHING - left) else ())


def test_a_third_effect_that_takes_most_of_what_neighbours_share_is_no_coincidence() -> None:
    """c wins 70 of 870, and 70 beside 600. The errors that neighbours share inflate the variance by 4 without it, by 1.5 or 3 with it."""
    scores = {"abc": 600.0, "ab": 670.0, "ac": 1000.0, "bc": 1000.0}
    for with_it, kept in ((1.5, "abc"), (3.0, "ab")):
        judge: Any = Judge(scores, least_mm=0.1)
        judge.inflation = lambda members, with_it=with_it: with_it if len(members) == 3 else 4.0
        assert small_room.takes(judge, (0, 1, 2), (0, 1)) == pytest.approx((4.0 - with_it) / 4.0)
        assert named(judge, without_small(judge, hypothesis(judge, "abc"))[0]) == kept


def test_of_four_effects_the_smallest_has_no_such_excuse() -> None:
    """Four effects together leave nothing of any error."""
    scores = {"abcd": 600.0, "abc": 670.0, "abd": 1000.0, "acd": 1000.0, "bcd": 1000.0, "ab": 1500.0, "ac": 1500.0, "bc": 1500.0}
    judge: Any = Judge(scores, least_mm=0.1)
    judge.inflation = lambda members: 5.0 - len(members)
    assert named(judge, without_small(judge, hypothesis(judge, "abcd"))[0]) == "abc"


@pytest.mark.parametrize(("what", "kept"), [({}, "ab"), ({"lens": "c"}, "ac"), ({"late": "c"}, "ac"), ({"mount": "c"}, "ac")])
def test_a_wrong_lens_and_late_stamps_stay_however_little_they_show_and_count_as_one_of_the_effects(
    what: dict[str, str], kept: str
) -> None:
    """Of a, b and c, c explains least, as the lens that is freed or the arms take its pixels; b is next."""
    scores = {"abc": 600.0, "ab": 614.0, "ac": 640.0, "bc": 1000.0, "a": 660.0}
    judge: Any = Judge(scores, least_mm=0.1, **what)  # type: ignore[arg-type]
    assert named(judge, without_small(judge, hypothesis(judge, "abc"))[0]) == kept


def test_motion_is_judged_at_edges_and_counts_as_no_effect_here() -> None:
    """c wins 14 of 400: small beside two other effects, unless it is motion."""
    scores = {"abc": 600.0, "ab": 614.0, "ac": 1000.0, "bc": 1000.0}
    for name, kept in (("c", "ab"), ("motion", "abc")):
        judge: Any = Judge(scores, ["a", "b", name], least_mm=0.1)
        assert named(judge, without_small(judge, hypothesis(judge, "abc"))[0]) == kept


def test_two_effects_are_believed_however_small() -> None:
    judge: Any = Judge({"ab": 500.0, "a": 501.0, "b": 900.0})
    assert named(judge, without_small(judge, hypothesis(judge, "ab"))[0]) == "ab"


@pytest.mark.parametrize("kind", ["free", "hand"])
def test_free_functions_and_hand_eye_are_not_counted_but_what_they_explain_is(kind: str) -> None:
    """c wins 70: 15 % of 470, but not of the 1070 that d's 600 make it."""
    scores = {"abcd": 300.0, "abd": 370.0, "acd": 500.0, "bcd": 500.0, "abc": 900.0, "ab": 950.0}
    judge: Any = Judge(scores, least_mm=0.01, **{kind: "d"})  # type: ignore[arg-type]
    assert named(judge, without_small(judge, hypothesis(judge, "abcd"))[0]) == "abcd", "70 of 300 left are enough"
    more: Any = Judge(scores, least_mm=0.01, small_left=1.0, **{kind: "d"})  # type: ignore[arg-type]
    assert named(more, without_small(more, hypothesis(more, "abcd"))[0]) == "abd"
    three: Any = Judge({"abd": 300.0, "ad": 310.0, "bd": 310.0, "ab": 900.0}, **{kind: "d"})  # type: ignore[arg-type]
    assert named(three, without_small(three, hypothesis(three, "abd"))[0]) == "abd"


def test_small_ones_below_the_tolerance_are_not_told() -> None:
    """c's 70 of 100 pixels are 1.7 mm RMS."""
    scores = {"abc": 600.0, "ab": 670.0, "ac": 1000.0, "bc": 1000.0}
    for least, told in ((1.6, ("c",)), (1.7, ())):
        judge: Any = Judge(scores, least_mm=least)
        assert without_small(judge, hypothesis(judge, "abc"))[1] == told


def test_of_two_parts_of_one_effect_the_second_is_no_effect_more() -> None:
    judge: Any = Judge({"abc": 600.0, "ab": 610.0}, ["x", "y", "y"])
    assert without_small(judge, hypothesis(judge, "abc"))[1] == ()
    assert small_room._names(judge, hypothesis(judge, "abc")) == ["x", "y"]


@pytest.mark.parametrize(
    ("other", "rest", "tied"),
    [
        (506.0, {}, (1,)),
        (506.1, {}, ()),
        (450.0, {}, (1,)),
        (450.0, {"implausible": ("b",)}, ()),
        (450.0, {"free": "b"}, ()),
        (450.0, {"names": ["x", "x"]}, ()),
    ],
)
def test_what_explains_nearly_as_much_in_its_place_is_a_tie(
    monkeypatch: pytest.MonkeyPatch, other: float, rest: dict[str, Any], tied: tuple[int, ...]
) -> None:
    monkeypatch.setattr(ties_room, "_hides", lambda *_: True)
    judge: Any = Judge({"a": 500.0, "b": other}, **rest)
    assert stand_ins(judge, hypothesis(judge, "a"), 0) == tied


@pytest.mark.parametrize(("of_member", "of_other", "tied"), [(2, 16, ()), (2, 4, (1,)), (16, 41, (1,)), (8, 11, (1,)), (16, 2, (1,))])
def test_a_field_of_many_coefficients_is_no_rival_of_a_formula(
    monkeypatch: pytest.MonkeyPatch, of_member: int, of_other: int, tied: tuple[int, ...]
) -> None:
    monkeypatch.setattr(ties_room, "_hides", lambda *_: True)
    judge: Any = Judge({"a": 500.0, "b": 500.0})
    judge.design.groups = (np.arange(of_member), np.arange(of_other))
    assert stand_ins(judge, hypothesis(judge, "a"), 0) == tied


def test_of_several_forms_the_best_is_named_and_the_best_effect_first(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ties_room, "_hides", lambda *_: True)
    judge: Any = Judge({"a": 500.0, "b": 504.0, "c": 503.0, "d": 502.0, "e": 505.0}, ["w", "x", "x", "y", "x"])
    assert stand_ins(judge, hypothesis(judge, "a"), 0) == (3, 2)


def test_what_does_not_hide_it_or_contains_it_is_no_tie(monkeypatch: pytest.MonkeyPatch) -> None:
    scores = {"a": 500.0, "b": 500.0, "c": 500.0}
    monkeypatch.setattr(ties_room, "_hides", lambda judge, _current, _place, _member, other, _rest: judge.letters[other] != "b")
    judge: Any = Judge(scores, effects={"c": effect(rest="a")})
    assert stand_ins(judge, hypothesis(judge, "a"), 0) == ()
    plain: Any = Judge(scores, effects={"c": effect(rest="z")})
    assert stand_ins(plain, hypothesis(plain, "a"), 0) == (2,)


@pytest.mark.parametrize(("left", "hides"), [(24.9, True), (25.1, False)])
def test_a_map_is_hidden_where_another_leaves_a_quarter_of_it(monkeypatch: pytest.MonkeyPatch, left: float, *, hides: bool) -> None:
    """Beside the rest alone 100 of the map's energy show."""
    judge: Any = Judge({"abc": 1.0, "ac": 1.0})
    judge.design.groups = ("A", "B", "C")
    judge.design.system.left_of = lambda target, theta, columns, inflate: {(2,): 100.0, (2, 1): left}[columns]
    judge.columns = tuple
    judge.fit = lambda _: None
    monkeypatch.setattr(ties_room, "coefficients", lambda *_: "theta")
    assert ties_room._hides(judge, hypothesis(judge, "ac"), 0, 0, 1, [2]) is hides


@pytest.mark.parametrize(("off", "tied"), [("", (1, 2)), ("b", (2,))])
def test_what_leaves_hand_eye_beyond_its_calibration_does_not_stand_in_for_it(
    monkeypatch: pytest.MonkeyPatch, off: str, tied: tuple[int, ...]
) -> None:
    monkeypatch.setattr(ties_room, "_hides", lambda *_: True)
    judge: Any = Judge({"a": 500.0, "b": 500.0, "c": 500.0}, hand="a", off=off)
    assert stand_ins(judge, hypothesis(judge, "a"), 0) == tied


@pytest.mark.parametrize(("needed", "tied"), [(("b",), (2,)), ((), (1, 2))])
def test_what_leaves_the_lens_beyond_its_calibration_does_not_stand_in_for_a_wrong_lens(
    monkeypatch: pytest.MonkeyPatch, needed: tuple[str, ...], tied: tuple[int, ...]
) -> None:
    monkeypatch.setattr(ties_room, "_hides", lambda *_: True)
    judge: Any = Judge({"a": 500.0, "b": 500.0, "c": 500.0}, ["intrinsics", "b", "c"])
    monkeypatch.setattr(judge, "needed_by_calibration", lambda name, trial: name == "intrinsics" and judge.text(trial.members) in needed)
    assert stand_ins(judge, hypothesis(judge, "a"), 0) == tied


@pytest.mark.parametrize(("beside", "hides"), [(13.9, True), (14.1, False)])
def test_hand_eye_is_hidden_where_it_wins_too_little_beside_another(beside: float, *, hides: bool) -> None:
    judge: Any = Judge({"bc": 500.0, "abc": 500.0 - beside, "ac": 1.0}, hand="a")
    assert ties_room._hides(judge, hypothesis(judge, "ac"), 0, 0, 1, [2]) is hides
