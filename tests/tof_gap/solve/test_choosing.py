# SPDX-License-Identifier: Apache-2.0
"""Each step of the selection on scores that are given: what is added, exchanged, dropped, tied, and what is small."""

from __future__ import annotations

from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from tof_gap.limits.solve import SelectLimits
from tof_gap.solve import select as room
from tof_gap.solve import small as small_room
from tof_gap.solve import ties as ties_room
from tof_gap.solve.judge import Hypothesis
from tof_gap.solve.select import _best_addition, _exchange, _grown, _lacking, _plain, _prune, _rough, _steady
from tof_gap.solve.small import without_small
from tof_gap.solve.ties import stand_ins
from tof_gap.solve.worth import rescored, visible_m, worth

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

VIEWS = 6
NOTHING = 1000.0
"""Held-out chi-square of no effect at all."""


class Judge:
    """Stands for a selector: candidates by letter, the score of every hypothesis by the letters of its members."""

    def __init__(
        self,
        scores: Mapping[str, float],
        names: Sequence[str] | None = None,
        *,
        effects: Mapping[str, Any] | None = None,
        free: str = "",
        hand: str = "",
        implausible: Sequence[str] = (),
        **limits: float,
    ) -> None:
        self.letters = sorted({letter for members in scores for letter in members})
        self.scores, self.free, self.hand, self.implausible = scores, free, hand, set(implausible)
        self.config = SelectLimits(**limits)  # type: ignore[arg-type]
        self.scored: list[str] = []
        called = names or self.letters
        candidates = [
            SimpleNamespace(name=name, effect=(effects or {}).get(letter), free=None)
            for letter, name in zip(self.letters, called, strict=True)
        ]
        self.design: Any = SimpleNamespace(
            candidates=candidates,
            system=SimpleNamespace(pixels=np.full(4, 25.0), sigma=2e-3),
            without=lambda members, name: tuple(m for m in members if candidates[m].name != name),
        )

    def text(self, members: Sequence[int]) -> str:
        return "".join(sorted(self.letters[m] for m in members))

    def score(self, members: Sequence[int], inflate: float) -> Hypothesis:
        self.scored.append(self.text(members))
        whole = self.scores[self.text(members)] if members else NOTHING
        return Hypothesis(tuple(members), np.full(VIEWS, whole / VIEWS), inflate)

    def inflation(self, members: Sequence[int]) -> float:
        return 1.0 + len(members)

    def plausible(self, hypothesis: Hypothesis) -> bool:
        return self.text(hypothesis.members) not in self.implausible

    def repeats(self, member: int, members: Sequence[int]) -> bool:
        return self.design.candidates[member].name in {self.design.candidates[m].name for m in members}

    def gain(self, member: int) -> float:
        return self.config.hand_gain if self.letters[member] in self.hand else self.config.gain

    def share(self, _: int) -> float:
        return self.config.share

    def is_free(self, member: int) -> bool:
        return self.letters[member] in self.free

    def frees_hand(self, members: Sequence[int]) -> bool:
        return any(self.letters[m] in self.hand for m in members)


def hypothesis(judge: Any, text: str, inflate: float = 1.0) -> Hypothesis:
    return judge.score([judge.letters.index(letter) for letter in text], inflate)  # type: ignore[no-any-return]


def named(judge: Any, found: Hypothesis | None) -> str | None:
    return None if found is None else judge.text(found.members)


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
    assert _steady(before, after, 30.0, SelectLimits()) is steady


def test_a_gain_of_one_view_is_no_addition(monkeypatch: pytest.MonkeyPatch) -> None:
    judge: Any = Judge({"a": 500.0})
    monkeypatch.setattr(room, "_steady", lambda *_: False)
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


def effect(**facts: Any) -> Any:
    return SimpleNamespace(**{"REST": "", "LACKS": 0.0, "LACKS_ON_A_PART": 0.0, "ROUGH": 0.0, "SMEARS": False, **facts})


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
    of = {"a": effect(REST="b" if "names" in rest else "c"), "b": effect()}
    judge: Any = Judge({"ab": 200.0, "b": 900.0, "a": 400.0, "bc": 200.0 + own, "bb": 200.0 + own, "c": 500.0}, effects=of, **rest)
    assert named(judge, _plain(judge, hypothesis(judge, "ab"))) == kept


def test_of_an_effect_without_such_a_rest_nothing_gives_way() -> None:
    judge: Any = Judge({"a": 500.0}, effects={"a": effect(REST="missing")})
    before = hypothesis(judge, "a")
    assert _plain(judge, before) is before


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


def test_of_several_forms_the_best_is_named_and_the_best_effect_first(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ties_room, "_hides", lambda *_: True)
    judge: Any = Judge({"a": 500.0, "b": 504.0, "c": 503.0, "d": 502.0, "e": 505.0}, ["w", "x", "x", "y", "x"])
    assert stand_ins(judge, hypothesis(judge, "a"), 0) == (3, 2)


def test_what_does_not_hide_it_or_contains_it_is_no_tie(monkeypatch: pytest.MonkeyPatch) -> None:
    scores = {"a": 500.0, "b": 500.0, "c": 500.0}
    monkeypatch.setattr(ties_room, "_hides", lambda judge, _current, _place, _member, other, _rest: judge.letters[other] != "b")
    judge: Any = Judge(scores, effects={"c": effect(REST="a")})
    assert stand_ins(judge, hypothesis(judge, "a"), 0) == ()
    plain: Any = Judge(scores, effects={"c": effect(REST="z")})
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


@pytest.mark.parametrize(("beside", "hides"), [(13.9, True), (14.1, False)])
def test_hand_eye_is_hidden_where_it_wins_too_little_beside_another(beside: float, *, hides: bool) -> None:
    judge: Any = Judge({"bc": 500.0, "abc": 500.0 - beside, "ac": 1.0}, hand="a")
    assert ties_room._hides(judge, hypothesis(judge, "ac"), 0, 0, 1, [2]) is hides
