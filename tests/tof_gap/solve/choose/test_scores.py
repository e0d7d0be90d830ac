# SPDX-License-Identifier: Apache-2.0
"""The score of a hypothesis from its parts: prices, shares, bounds of coefficients, arm errors, and what maps have in common."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tof_gap.limits.solve import SelectLimits
from tof_gap.solve.choose import select as room
from tof_gap.solve.choose.judge import Hypothesis, Selector
from tof_gap.solve.choose.select import _absorbable, _along, _described
from tof_gap.solve.hypotheses.candidate import HAND_EYE

LIMITS = SelectLimits()


def candidate(name: str, *, free: Any = None, repeatable: bool = False, beside: str | None = None, **effect: Any) -> Any:
    facts = {"SMEARS": False, "free_form": False, "LINEAR": ("a", "b"), "OWN": (), "bounds": (-np.ones(2), np.ones(2))} | effect
    made = None if free is not None or name == HAND_EYE else SimpleNamespace(**facts)
    return SimpleNamespace(
        name=name,
        effect=made,
        free=free,
        excludes=lambda other: other.name == name and not repeatable,
        stands_beside=lambda others: beside is None or any(o.name == beside for o in others),
    )


def selector(*candidates: Any, always: tuple[int, ...] = (), **design: Any) -> Selector:
    """A selector over candidates of two columns each, in steps of their number."""
    made: Any = object.__new__(Selector)
    made.config, made._empty, made._folded = LIMITS, {}, {}
    made._forms = {c.name: sum(o.name == c.name for o in candidates) for c in candidates}
    made.design = SimpleNamespace(
        candidates=candidates,
        always=always,
        scale=np.full(2 * len(candidates), 10.0),
        placed=lambda members: [(candidates[m], np.arange(2 * m, 2 * m + 2), slice(2 * i, 2 * i + 2)) for i, m in enumerate(members)],
        **design,
    )
    return made  # type: ignore[no-any-return]


@pytest.mark.parametrize(
    ("one", "always", "share"),
    [
        (candidate("wiggling"), (), LIMITS.share),
        (candidate("unknown", free="f"), (), LIMITS.unknown_share),
        (candidate("motion", SMEARS=True), (), 0.0),
        (candidate(HAND_EYE), (), 0.0),
        (candidate("time_sync"), (), 0.0),
        (candidate("intrinsics"), (), LIMITS.share),
        (candidate("intrinsics"), (4,), 0.0),
        (candidate("wiggling"), (4,), LIMITS.share),
    ],
)
def test_the_share_that_a_candidate_must_explain(one: Any, always: tuple[int, ...], share: float) -> None:
    assert selector(one, always=always).share(0) == share


def test_forms_of_one_name_pay_for_their_number_and_free_functions_for_what_is_explained(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of nothing 1000 are left: of 400 held out, a free function pays 25 and 3 % of 600; where more is left than of nothing, 25."""
    curve, formula = (SimpleNamespace(FORMULA=formula) for formula in (False, True))
    free = candidate("unknown", free=curve), candidate("pattern", free_form=True), candidate("unknown", free=formula)
    made = selector(*[candidate("wiggling")] * 3, candidate("offset"), *free)
    monkeypatch.setattr(Selector, "score", lambda *_: Hypothesis((), np.array([600.0, 400.0]), 1.0))
    held_out = np.array([300.0, 100.0])
    assert made._price([0, 3], held_out, 1.0) == pytest.approx(2 * np.log(3))
    assert made._price([0, 4], held_out, 1.0) == pytest.approx(2 * np.log(3) + 25 + 0.03 * 600)
    assert made._price([4, 5], held_out, 1.0) == pytest.approx(2 * (25 + 0.03 * 600))
    assert made._price([4], 3 * held_out, 1.0) == pytest.approx(25.0)
    assert made._price([3], held_out, 1.0) == 0.0
    assert made._price([6], held_out, 1.0) == pytest.approx(2 * np.log(2)), "a formula without a name, of two forms without one"
    assert Hypothesis((3,), held_out, 1.0, 2.5).score == 402.5


def test_what_a_hypothesis_holds_once_is_not_added_again() -> None:
    made = selector(candidate("wiggling"), candidate("wiggling"), candidate("part", repeatable=True), candidate("part", repeatable=True))
    assert made.repeats(0, [0])
    assert made.repeats(1, [0])
    assert made.repeats(2, [2])
    assert not made.repeats(3, [2])
    assert not made.repeats(0, [2, 3])


def test_what_stands_beside_another_alone_is_added_to_that_one_alone() -> None:
    made = selector(candidate("long", beside="short"), candidate("short"), candidate("other"))
    assert made.repeats(0, [])
    assert made.repeats(0, [2])
    assert not made.repeats(0, [1, 2])
    assert made.repeats(2, [0])  # since a member would lack the other
    assert not made.repeats(2, [0, 1])


def plausible(theta: tuple[float, float], *, sd: float = 0.5, **effect: Any) -> bool:
    """One effect of two coefficients between -1 and 1, in units of ten; each known to `sd` of those."""
    made = selector(candidate("wiggling", **effect))
    fitted = SimpleNamespace(theta=10.0 * np.array(theta), theta_cov=np.diag([(10 * sd) ** 2] * 2))
    made.fit = lambda _: fitted  # type: ignore[method-assign, assignment, return-value]
    return made.plausible(Hypothesis((0,), np.zeros(2), 1.0))


@pytest.mark.parametrize(
    ("theta", "within"), [((0.9, -0.9), True), ((1.99, 0.0), True), ((2.01, 0.0), False), ((0.0, -1.99), True), ((0.0, -2.01), False)]
)
def test_coefficients_are_within_their_bounds_to_two_standard_errors(theta: tuple[float, float], *, within: bool) -> None:
    assert plausible(theta) is within


@pytest.mark.parametrize(
    ("own", "theta", "there"),
    [(("b",), (0.0, 0.55), True), (("b",), (0.9, 0.54), False), (("a", "b"), (0.4, 0.4), True), (("a", "b"), (0.38, 0.38), False)],
)
def test_coefficients_that_define_an_effect_differ_from_zero(own: tuple[str, ...], theta: tuple[float, float], *, there: bool) -> None:
    """Their chi-square is 30 at least: of one coefficient 5.48 deviations of 0.1."""
    assert plausible(theta, sd=0.1, OWN=own) is there


def test_an_effect_of_groups_of_columns_has_no_bounds() -> None:
    assert plausible((99.0, 99.0), LINEAR=("a",))


def test_arm_errors_add_what_the_solution_moves_and_speak_together_for_a_mount() -> None:
    normal = SimpleNamespace(own_error=np.full((4, 6), 1e-3), own_info=np.full(6, 1 / 2e-3**2))
    made = selector(candidate("wiggling"), system=SimpleNamespace(normal=normal))
    arm = np.tile([1e-3, -1e-3, 0, 0, 0, 0], (4, 1))
    made.fit = lambda _: SimpleNamespace(arm=arm)  # type: ignore[method-assign, assignment, return-value]
    anything = Hypothesis((0,), np.zeros(4), 1.0)
    np.testing.assert_allclose(made.arms(anything), np.tile([2e-3, 0, 1e-3, 1e-3, 1e-3, 1e-3], (4, 1)))
    assert made.arms_sd.shape == (4, 6)
    np.testing.assert_allclose(made.arms_sd, 2e-3)
    assert made.arms_alike(anything) == pytest.approx(4 * (1.0 + 4 * 0.25))


def test_what_columns_could_take_from_the_maps_of_others(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of 500 that the others' maps show, 120 are left beside the member's columns; in units of the inflated noise of 4."""
    asked: list[Any] = []

    def left_of(maps: Any, theta: Any, columns: Any, inflate: float) -> float:
        asked.append((tuple(maps), theta.tolist(), inflate))
        return {(): 500.0, (1,): 120.0}[columns]

    made: Any = selector(
        candidate("a"),
        candidate("b"),
        candidate("c"),
        candidate(HAND_EYE),
        candidate("unknown", free="f"),
        candidate("b"),
        system=SimpleNamespace(left_of=left_of),
    )
    made.design.own = list
    made.columns, made.fit = tuple, lambda _: None
    monkeypatch.setattr(room, "coefficients", lambda _judge, _current, _solution, i: np.array([float(i)]))
    whole = Hypothesis((0, 1, 2), np.zeros(2), 4.0)
    assert _along(made, whole, 1, [0, 2]) == pytest.approx(380.0 / 4.0)
    assert asked == [((0, 2), [0.0, 2.0], 4.0)] * 2
    assert _absorbable(made, whole, 1) == pytest.approx(95.0)
    assert _along(made, whole, 1, []) == 0.0
    assert _absorbable(made, Hypothesis((1,), np.zeros(2), 4.0), 0) == 0.0
    assert _along(made, Hypothesis((3, 1), np.zeros(2), 4.0), 0, [1]) == 0.0, "hand-eye has no map and no columns"
    assert _absorbable(made, Hypothesis((4, 1), np.zeros(2), 4.0), 0) == 0.0, "a free function may absorb what it likes"
    assert _absorbable(made, Hypothesis((1, 5), np.zeros(2), 4.0), 0) == 0.0, "another form of the same effect adds no name"


def test_a_selection_tells_ties_of_effects_and_observables_by_what_is_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    free = [SimpleNamespace(quantity=q) for q in ("range_m", "amplitude")]
    made: Any = selector(candidate("unknown", free=free[0]), candidate("a"), candidate("unknown", free=free[1]))
    made.fit = lambda _: "fit"
    monkeypatch.setattr(room, "worth", lambda *_: (np.array([40.0, 90.0, 70.0]), None))
    monkeypatch.setattr(room, "stand_ins", lambda _judge, _current, place: (place + 10,))
    found = _described(made, Hypothesis((0, 1, 2), np.zeros(2), 1.0), ("small",))
    assert found.ties == ((), (11,), ())
    assert found.unknown == ("amplitude", "range_m")
    told: tuple[Any, ...] = (found.fit, found.small_together)
    assert told == ("fit", ("small",))
    nothing = _described(made, Hypothesis((), np.zeros(2), 1.0), ())
    assert (nothing.ties, nothing.unknown) == ((), ())


@pytest.mark.parametrize(("off", "always", "name", "rough", "needed"), [
    (2.0, (8, 9), "intrinsics", 0.0, True),  # two coefficients of 4 standard deviations: 32 of chi-square
    (1.9, (8, 9), "intrinsics", 0.0, False),
    (2.0, (8, 9), "intrinsics", 0.06, False),  # an inexact map beside it leaves as much
    (3.6, (8, 9), "intrinsics", 0.06, True),  # 104 of chi-square
    (9.0, (), "intrinsics", 0.0, False),  # no calibration is stated
    (9.0, (8, 9), "wiggling", 0.0, False),
])  # fmt: skip
def test_a_lens_is_needed_where_the_freed_one_would_contradict_its_calibration(
    monkeypatch: pytest.MonkeyPatch, off: float, always: tuple[int, ...], name: str, rough: float, *, needed: bool
) -> None:
    """Freed columns 8 and 9, 4 unknowns of poses before them, have a standard deviation of a half, and `off` for a coefficient without `name`."""
    info = np.concatenate([np.zeros(4), np.zeros(8), np.full(2, 4.0)])
    system = SimpleNamespace(normal=SimpleNamespace(info=info), poses=4)
    beside = candidate("wiggling", ROUGH=rough)
    made: Any = selector(beside, candidate("intrinsics", ROUGH=0.0), system=system, without=lambda members, _: list(members)[:1])
    made.design.always = np.array(always, np.int64)
    monkeypatch.setattr(Selector, "score", lambda _self, members, inflate: Hypothesis(tuple(members), np.zeros(3), inflate))
    monkeypatch.setattr(Selector, "fit", lambda _self, _: SimpleNamespace(theta=np.array([off, off, 99.0])))
    assert made.needed_by_calibration(name, Hypothesis((0, 1), np.zeros(3), 1.0)) is needed


@pytest.mark.parametrize(("chi2", "always", "hand", "off"), [
    (18.5, (8,), False, True),
    (17.5, (8,), False, False),  # position and turn at the largest errors that are stated
    (99.0, (), False, False),  # no calibration is stated
    (99.0, (8,), True, False),  # hand-eye is named
])  # fmt: skip
def test_hand_eye_contradicts_its_calibration_beyond_the_largest_stated_errors(
    monkeypatch: pytest.MonkeyPatch, chi2: float, always: tuple[int, ...], *, hand: bool, off: bool
) -> None:
    made: Any = selector(candidate("hand_eye" if hand else "wiggling"), system=SimpleNamespace(mount_chi2=lambda _: chi2))
    made.design.always = np.array(always, np.int64)
    monkeypatch.setattr(Selector, "fit", lambda _self, _: None)
    assert made.contradicts_mount(Hypothesis((0,), np.zeros(3), 1.0)) is off


@pytest.mark.parametrize(("without", "with_it", "always", "hand", "needed"), [
    (20.0, 3.0, (8,), False, True),
    (13.0, 3.0, (8,), False, False),  # within what a stated calibration allows
    (20.0, 15.0, (8,), False, False),  # the effect does not explain where hand-eye went
    (20.0, 3.0, (), False, False),  # no calibration is stated
    (20.0, 3.0, (8,), True, False),  # hand-eye is named
])  # fmt: skip
def test_an_effect_is_needed_where_hand_eye_would_contradict_its_calibration(
    monkeypatch: pytest.MonkeyPatch, without: float, with_it: float, always: tuple[int, ...], *, hand: bool, needed: bool
) -> None:
    """Chi-square of hand-eye against its prior, with two members and with one."""
    system = SimpleNamespace(mount_chi2=lambda members: with_it if members == 2 else without)
    drift = candidate("hand_eye" if hand else "temperature_drift")
    made: Any = selector(candidate("wiggling"), drift, system=system, without=lambda members, _: list(members)[:1])
    made.design.always = np.array(always, np.int64)
    monkeypatch.setattr(Selector, "fit", lambda _self, of: len(of.members))
    assert made.needed_by_mount(drift.name, Hypothesis((0, 1), np.zeros(3), 1.0)) is needed


@pytest.mark.parametrize(("without", "with_them", "name", "needed"), [
    (2.0, 1.0, "time_sync", True),
    (1.2, 1.0, "time_sync", False),  # an arm as inaccurate as that is usual
    (2.0, 1.5, "time_sync", False),  # late stamps do not explain the arm's errors
    (2.0, 1.0, "wiggling", False),
])  # fmt: skip
def test_late_stamps_are_needed_where_arm_errors_would_contradict_the_robot(
    monkeypatch: pytest.MonkeyPatch, without: float, with_them: float, name: str, *, needed: bool
) -> None:
    """Arm errors of each hypothesis in standard deviations of the robot's prior, alike over all axes."""
    made: Any = selector(candidate("wiggling"), candidate("time_sync"), without=lambda members, _: list(members)[:1])
    monkeypatch.setattr(Selector, "arms", lambda _self, of: np.full((4, 6), with_them if len(of.members) == 2 else without))
    monkeypatch.setattr(Selector, "arms_sd", np.ones((4, 6)))
    assert made.needed_by_robot(name, Hypothesis((0, 1), np.zeros(3), 1.0)) is needed


def test_late_stamps_are_needed_where_the_arm_errs_in_positions_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    made: Any = selector(candidate("wiggling"), candidate("time_sync"), without=lambda members, _: list(members)[:1])
    straight = np.repeat([[1.7, 1.7, 1.7, 1.2, 1.2, 1.2]], 4, axis=0)
    monkeypatch.setattr(Selector, "arms", lambda _self, of: np.full((4, 6), 0.6) if len(of.members) == 2 else straight)
    monkeypatch.setattr(Selector, "arms_sd", np.ones((4, 6)))
    assert made.needed_by_robot("time_sync", Hypothesis((0, 1), np.zeros(3), 1.0))
