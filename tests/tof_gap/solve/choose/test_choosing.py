# SPDX-License-Identifier: Apache-2.0
"""Each step of the selection on scores that are given: what is added, exchanged, dropped, tied, and what is small."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.tof_gap.scored import Judge, effect, hypothesis, named
from tof_gap.limits.solve import SelectLimits
from tof_gap.solve.choose import select as room
from tof_gap.solve.choose.judge import Hypothesis
from tof_gap.solve.choose.select import (
    _best_addition,
    _curved,
    _exchange,
    _grown,
    _lacking,
    _plain,
    _prune,
    _rough,
    weak,
    with_mount,
    won_steadily,
)
from tof_gap.solve.choose.worth import rescored, visible_m, worth
from tof_sensor.curve import Knots
from tof_sensor.effects.amplitude_bias import AmplitudeBias


@pytest.fixture(autouse=True)
def no_maps(monkeypatch: pytest.MonkeyPatch) -> None:
    """What maps could absorb needs columns, which these judges have not."""
    monkeypatch.setattr(room, "_absorbable", lambda *_: 0.0)
    monkeypatch.setattr(room, "_along", lambda *_: 0.0)


def test_worth_is_what_is_lost_without_a_member() -> None:
    judge: Any = Judge({"a": 700.0, "b": 900.0, "ab": 650.0})
    both = hypothesis(judge, "ab", inflate=4.0)
    lost, visible = worth(judge, both)
    np.testing.assert_allclose(lost, [250.0, 50.0])
    # 250 of 100 pixels in units of the noise of 2 mm, whose variance is inflated by 4.
    np.testing.assert_allclose(visible, 2e-3 * np.sqrt(np.array([250.0, 50.0]) * 4.0 / 100.0))
    assert visible_m(judge, both, -5.0) == 0.0
    assert rescored(judge, (0,)).inflate == 2.0


@pytest.mark.parametrize(
    ("scores", "added"),
    [
        ({"a": 970.0, "b": 971.0}, "a"),
        ({"a": 970.1, "b": 980.0}, None),
        ({"a": 960.0, "b": 900.0}, "b"),
        ({"a": 900.0, "b": 960.0}, "a"),
    ],
)
def test_the_addition_that_wins_most_is_made_if_it_wins_enough(scores: dict[str, float], added: str | None) -> None:
    judge: Any = Judge(scores)
    found = _best_addition(judge, hypothesis(judge, ""))
    assert named(judge, found) == added
    if found is not None:
        assert found.inflate == 2.0, "the noise is what the new members leave"


def test_an_implausible_or_repeated_addition_is_none() -> None:
    judge: Any = Judge({"a": 500.0, "b": 800.0, "c": 400.0, "ab": 300.0, "ac": 200.0}, ["x", "y", "x"], implausible=("c",))
    assert named(judge, _best_addition(judge, hypothesis(judge, ""))) == "a"
    assert named(judge, _best_addition(judge, hypothesis(judge, "a"))) == "ab"


def test_hand_eye_needs_less() -> None:
    scores = {"a": 985.0}
    assert named(Judge(scores, hand="a"), _best_addition(Judge(scores, hand="a"), hypothesis(Judge(scores, hand="a"), ""))) == "a"  # type: ignore[arg-type]
    assert _best_addition(Judge(scores), hypothesis(Judge(scores), "")) is None  # type: ignore[arg-type]


def test_hand_eye_is_looked_for_again_when_the_search_has_ended() -> None:
    """It wins 20 beside `a`; six effects of more pixels may have been added before it, and dropped again."""
    scores = {"a": 500.0, "h": 900.0, "ah": 480.0}
    judge: Any = Judge(scores, ["multipath", "hand_eye"], hand="h")
    assert named(judge, with_mount(judge, hypothesis(judge, "a"))) == "ah"
    assert named(judge, with_mount(judge, hypothesis(judge, "ah"))) == "ah"
    little: Any = Judge(scores | {"ah": 490.0}, ["multipath", "hand_eye"], hand="h")
    assert named(little, with_mount(little, hypothesis(little, "a"))) == "a"
    other: Any = Judge(scores, ["multipath", "wiggling"])
    assert named(other, with_mount(other, hypothesis(other, "a"))) == "a", "other effects have had their turn"


def test_hand_eye_that_contradicts_its_calibration_is_wrong_though_freeing_it_explains_little() -> None:
    scores = {"a": 500.0, "h": 900.0, "ah": 499.0}
    judge: Any = Judge(scores, ["multipath", "hand_eye"], hand="h", off="a")
    both = with_mount(judge, hypothesis(judge, "a"))
    assert named(judge, both) == "ah"
    assert all(place == 0 for _, place in weak(judge, both)), "nor is it dropped for that"
    as_stated: Any = Judge(scores, ["multipath", "hand_eye"], hand="h")
    assert named(as_stated, with_mount(as_stated, hypothesis(as_stated, "a"))) == "a"


@pytest.mark.parametrize(
    ("won", "steady"),
    [
        ((60.0, 10.0, 5.0, 4.9), False),  # without the best view 19.9 of 79.9 are left: less than a quarter
        ((60.0, 10.0, 5.0, 5.1), True),
        ((400.0, 20.0, 10.0, 1.0), True),  # 31 are all that is asked
        ((400.0, 20.0, 10.0, 0.0), False),
        ((400.0, 1.0, 0.0), True),  # fewer than four views
        ((100.0, 30.0, -10.0, 20.0, 5.0), True),
    ],
)
def test_more_than_one_view_must_gain(won: tuple[float, ...], *, steady: bool) -> None:
    before, after = Hypothesis((), np.array(won) + 7.0, 1.0), Hypothesis((0,), np.full(len(won), 7.0), 1.0)
    assert won_steadily(before, after, 30.0, SelectLimits()) is steady


def test_a_gain_of_one_view_is_no_addition(monkeypatch: pytest.MonkeyPatch) -> None:
    judge: Any = Judge({"a": 500.0})
    monkeypatch.setattr(room, "won_steadily", lambda *_: False)
    assert _best_addition(judge, hypothesis(judge, "")) is None


@pytest.mark.parametrize(("other", "ends"), [(798.9, "bc"), (799.1, "ac")])
def test_a_member_is_exchanged_for_what_does_better_by_more_than_one(other: float, ends: str) -> None:
    judge: Any = Judge({"ac": 800.0, "bc": other, "ab": 900.0, "abc": 500.0})
    found = _exchange(judge, hypothesis(judge, "ac"))
    assert named(judge, found) == ends
    assert found.inflate == 3.0


def test_an_exchange_is_plausible_and_no_repetition() -> None:
    scores = {"ac": 800.0, "bc": 700.0, "ab": 650.0, "cd": 600.0, "ad": 600.0, "bd": 600.0}
    judge: Any = Judge(scores, ["w", "x", "y", "y"], implausible=("bc",))
    # b for c is allowed and better; b for a is implausible; d has c's name but may stand in c's place.
    assert named(judge, _exchange(judge, hypothesis(judge, "ac"))) in {"ad", "bd"}
    only: Any = Judge({"ac": 800.0, "bc": 700.0, "ab": 850.0}, implausible=("bc",))
    assert named(only, _exchange(only, hypothesis(only, "ac"))) == "ac"


def test_exchanges_go_on_until_none_is_better() -> None:
    judge: Any = Judge({"ab": 800.0, "bc": 700.0, "ac": 750.0, "bd": 810.0, "ad": 810.0, "cd": 600.0})
    assert named(judge, _exchange(judge, hypothesis(judge, "ab"))) == "cd"


@pytest.mark.parametrize(
    ("alone", "kept"),
    [
        ({"a": 229.0, "b": 700.0}, "a"),  # b wins 29 beside a
        ({"a": 231.0, "b": 700.0}, "ab"),
        ({"a": 229.0, "b": 228.0}, "a"),  # both are weak: the one that shows less goes first, and the other is strong alone
    ],
)
def test_what_wins_less_than_is_asked_is_dropped(alone: dict[str, float], kept: str) -> None:
    judge: Any = Judge({"ab": 200.0, **alone}, share=0.0)
    found = _prune(judge, hypothesis(judge, "ab"))
    assert named(judge, found) == ("b" if alone == {"a": 229.0, "b": 228.0} else kept)


@pytest.mark.parametrize(("b_wins", "kept"), [(10.0, "a"), (13.0, "ab")])
def test_what_explains_too_small_a_share_of_what_shows_is_dropped(b_wins: float, kept: str) -> None:
    """Of a's 800 and b's own, b must have 1.5 %: 12.2; its gain alone, of hand-eye, would do at 5."""
    judge: Any = Judge({"ab": 100.0, "a": 100.0 + b_wins, "b": 900.0}, gain=5.0)
    assert named(judge, _prune(judge, hypothesis(judge, "ab"))) == kept


@pytest.mark.parametrize(("effects", "kept"), [(["x", "y", "y"], "abc"), (["x", "y", "z"], "a")])
def test_two_parts_of_one_effect_explain_its_share_together(effects: list[str], kept: str) -> None:
    """Of 820, b and c explain 10 each: less than 1.5 % each, and more together."""
    judge: Any = Judge({"abc": 100.0, "ab": 110.0, "ac": 110.0, "bc": 900.0, "a": 120.0, "b": 900.0, "c": 900.0}, effects, gain=5.0)
    assert named(judge, _prune(judge, hypothesis(judge, "abc"))) == kept


@pytest.mark.parametrize(("absorbed", "kept"), [(490.0, "ab"), (510.0, "a")])
def test_what_wins_less_than_a_tenth_of_what_it_could_absorb_is_dropped(
    monkeypatch: pytest.MonkeyPatch, absorbed: float, kept: str
) -> None:
    judge: Any = Judge({"ab": 100.0, "a": 150.0, "b": 900.0})
    monkeypatch.setattr(room, "_absorbable", lambda judge, current, i: absorbed if judge.letters[current.members[i]] == "b" else 0.0)
    assert named(judge, _prune(judge, hypothesis(judge, "ab"))) == kept


@pytest.mark.parametrize("of", ["_lacking", "_rough"])
@pytest.mark.parametrize(("asked", "kept"), [(49.0, "ab"), (51.0, "a")])
def test_what_wins_less_than_inexact_maps_leave_is_dropped(monkeypatch: pytest.MonkeyPatch, of: str, asked: float, kept: str) -> None:
    judge: Any = Judge({"ab": 100.0, "a": 150.0, "b": 900.0})
    monkeypatch.setattr(room, of, lambda judge, current, i, *_: asked if judge.letters[current.members[i]] == "b" else 0.0)
    assert named(judge, _prune(judge, hypothesis(judge, "ab"))) == kept


def test_everything_may_be_dropped() -> None:
    judge: Any = Judge({"a": 980.0})
    assert _prune(judge, hypothesis(judge, "a")).members == ()


@pytest.mark.parametrize(
    ("own", "rest", "kept"),
    [
        (10.0, {}, "bc"),  # a's terms beside those of c win 10: less than 1.5 % of all that shows
        (20.0, {}, "ab"),
        (10.0, {"implausible": ("bc",)}, "ab"),
        (10.0, {"names": ["a", "b", "b"]}, "ab"),  # c stands beside itself: a repetition
    ],
)
def test_terms_that_explain_too_little_give_way_to_the_effect_that_is_left_without_them(
    own: float, rest: dict[str, Any], kept: str
) -> None:
    """Without a 900 are left, without b 400, of 200: a shows 700 and b 200."""
    of = {"a": effect(rest="b" if "names" in rest else "c"), "b": effect()}
    judge: Any = Judge({"ab": 200.0, "b": 900.0, "a": 400.0, "bc": 200.0 + own, "bb": 200.0 + own, "c": 500.0}, effects=of, **rest)
    assert named(judge, _plain(judge, hypothesis(judge, "ab"))) == kept


@pytest.mark.parametrize(("own", "kept"), [(2.0, "bc"), (4.0, "ab")])
def test_before_a_board_own_terms_are_compared_with_what_shows_beyond_the_rest(own: float, kept: str) -> None:
    """Of the 700 that a shows, c shows all but `own`: 1.5 % of the 200 of b is 3."""
    of = {"a": effect(rest="c"), "b": effect()}
    scores = {"ab": 200.0, "b": 900.0, "a": 400.0, "bc": 200.0 + own, "c": 500.0}
    judge: Any = Judge(scores, effects=of, own_mm=0.0)
    judge.apart = object()
    assert named(judge, _plain(judge, hypothesis(judge, "ab"))) == kept


def test_what_the_views_do_not_determine_is_dropped(monkeypatch: pytest.MonkeyPatch) -> None:
    judge: Any = Judge({"ab": 100.0, "a": 600.0, "b": 900.0})
    monkeypatch.setattr(room, "shown", lambda judge, current, i: judge.letters[current.members[i]] == "a")
    assert named(judge, _prune(judge, hypothesis(judge, "ab"))) == "a"


def test_of_an_effect_without_such_a_rest_nothing_gives_way() -> None:
    judge: Any = Judge({"a": 500.0}, effects={"a": effect(rest="missing")})
    before = hypothesis(judge, "a")
    assert _plain(judge, before) is before


CURVE = AmplitudeBias.curve(Knots((0.0, 1.0, 2.0), (0.0, 0.0, 0.0)))


@pytest.mark.parametrize(
    ("left", "limits", "kept"),
    [
        (474.0, {}, "b"),  # 26 of chi-square: more than a free function pays
        (476.0, {}, "a"),
        (484.0, {"unknown": 1.0}, "b"),  # 16, more than 3 % of the 500 that the formula explains
        (486.0, {"unknown": 1.0}, "a"),
    ],
)
def test_a_formula_gives_way_to_a_curve_of_its_effect_that_explains_clearly_more(left: float, limits: dict[str, Any], kept: str) -> None:
    judge: Any = Judge({"a": 500.0, "b": left}, ["x", "x"], effects={"a": AmplitudeBias(), "b": CURVE}, **limits)
    assert named(judge, _curved(judge, hypothesis(judge, "a"))) == kept


@pytest.mark.parametrize(
    ("names", "effects"),
    [
        (["x", "y"], {"a": AmplitudeBias(), "b": CURVE}),  # a curve of another effect
        (["x", "x"], {"a": CURVE, "b": CURVE}),  # a curve already
        (["x", "x"], {"a": AmplitudeBias(), "b": AmplitudeBias(form="inverse")}),  # another formula: additions and exchanges judge that
    ],
)
def test_nothing_but_a_formula_gives_way_to_nothing_but_its_own_curve(names: list[str], effects: dict[str, Any]) -> None:
    judge: Any = Judge({"a": 500.0, "b": 100.0}, names, effects=effects)
    assert named(judge, _curved(judge, hypothesis(judge, "a"))) == "a"


def test_maps_lack_what_is_along_them(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(room, "_along", lambda _judge, _current, _place, others: 100.0 * (1 + others[0]))
    of = {"a": effect(LACKS=0.12, LACKS_ON_A_PART=1.0), "b": effect(LACKS=0.2, LACKS_ON_A_PART=0.5), "c": effect(), "d": effect(part=0)}
    judge: Any = Judge({"abcd": 1.0}, effects=of)
    whole = hypothesis(judge, "abcd")
    assert _lacking(judge, whole, 2) == pytest.approx(max(0.12 * 100, 0.2 * 200))
    assert _lacking(judge, whole, 3) == pytest.approx(max(1.0 * 100, 0.5 * 200))
    assert _lacking(judge, whole, 1) == pytest.approx(12.0), "its own map is not among the others"
    alone: Any = Judge({"c": 1.0}, effects=of)
    assert _lacking(alone, hypothesis(alone, "c"), 0) == 0.0


def test_rough_maps_leave_a_share_of_what_they_win_and_motion_all_of_hand_eye() -> None:
    of = {"a": effect(ROUGH=0.1), "b": effect(ROUGH=0.3), "c": effect(SMEARS=True)}
    judge: Any = Judge({"abcd": 1.0, "abd": 1.0}, effects=of, hand="d")
    whole, lost = hypothesis(judge, "abcd"), np.array([500.0, 100.0, 50.0, 20.0])
    assert _rough(judge, whole, 2, lost) == pytest.approx(50.0)
    assert _rough(judge, whole, 0, lost) == pytest.approx(30.0)
    assert _rough(judge, whole, 3, lost) == np.inf
    assert _rough(judge, hypothesis(judge, "abd"), 2, lost) == 0.0


def test_effects_are_added_until_none_wins_or_five_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    letters = "abcdefg"
    scores = {"".join(letters[i] for i in range(7) if bits >> i & 1): 1000.0 - 100.0 * bits.bit_count() - bits for bits in range(1, 128)}
    judge: Any = Judge(scores)
    assert len(_grown(judge, ()).members) == 5
    again: Any = Judge(scores, most=2)
    assert named(again, _grown(again, ())) == "fg"
    same: Any = Judge(scores, ["x", "y", "x", "y", "x", "y", "x"], most=2)
    monkeypatch.setattr(same, "repeats", lambda member, members: member in members)
    assert len(_grown(same, ()).members) in {2, 3, 4, 5, 6, 7}


@pytest.mark.parametrize(("lens", "kept"), [("b", "ab"), ("", "a")])
def test_it_is_not_dropped_as_weak(lens: str, kept: str) -> None:
    judge: Any = Judge(
        {"a": 500.0, "b": 900.0, "ab": 498.0}, ["wave", "intrinsics"], effects={"a": effect(ROUGH=0.1), "b": effect()}, lens=lens
    )
    assert named(judge, _prune(judge, hypothesis(judge, "ab"))) == kept
