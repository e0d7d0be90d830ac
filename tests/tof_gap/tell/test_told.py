# SPDX-License-Identifier: Apache-2.0
"""What an account takes from the detectors and from the figures, with each of them given; and the floor of a pixel by hand."""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np
import pytest

from tof_gap.limits.foreign import ForeignLightLimits
from tof_gap.limits.missing import MissingLimits
from tof_gap.limits.report import ReportLimits
from tof_gap.limits.solve import SelectLimits
from tof_gap.seen import detected
from tof_gap.seen.finding import Finding
from tof_gap.seen.missing import effects as missing
from tof_gap.seen.noise import effects as noise
from tof_gap.tell import account as room
from tof_gap.tell.account import _findings, _gap, _named_m, account, rough_m
from tof_gap.tell.diagnosis import Diagnosis, doubted
from tof_gap.tell.figures.floor import _shared, shown2
from tof_gap.tell.figures.shrink import Errors, Shrink
from tof_sensor.effects.amplitude_bias import AmplitudeBias
from tof_sensor.effects.dropout import Dropout
from tof_sensor.effects.interference import Interference
from tof_sensor.effects.motion import Motion
from tof_sensor.effects.noise import Noise
from tof_sensor.effects.phase_wrap import PhaseWrap
from tof_sensor.stated import NOTHING_STATED

NOTHING: Any = None
NONE = Errors(0.0, 0.0, 0.0)


def gap_of(shrink: float) -> Shrink:
    return Shrink(NONE, NONE, 0.0, shrink, (0.0, 1.0))


BY = {(): 0.0, ("a",): 0.6, ("b",): 0.2, ("a", "b"): 0.7}
"""How far effects shrink the gap."""


@dataclass
class Counted:
    """Stands for the figures of two effects and two views."""

    residual: list[Any]
    maps: tuple[str, ...] = ("a", "b")

    def shrink(self, names: list[str]) -> Shrink:
        return gap_of(BY[tuple(sorted(names))])

    added2: ClassVar = {"a": 0.6, "b": 0.2}


@pytest.fixture
def counted(monkeypatch: pytest.MonkeyPatch) -> list[tuple[Finding, ...]]:
    """The findings that figures are asked for."""
    asked: list[tuple[Finding, ...]] = []

    def figures(_solved: Any, findings: tuple[Finding, ...], *_: object) -> Any:
        asked.append(findings)
        return Counted([np.zeros((2, 2)), np.ones((2, 2))])

    monkeypatch.setattr(room, "figures", figures)
    monkeypatch.setattr(room, "give_back", lambda: None)
    monkeypatch.setattr(room, "_findings", lambda *_, **__: (FOUND,))
    monkeypatch.setattr(room, "contents", lambda _: np.arange(20.0)[:, None])
    return asked


FOUND, RAY = Finding(Noise(extra_m=0.001), 1.0), Finding(Dropout(threshold=0.1), 1.0, share=np.full((2, 2, 2), 0.5))
GIVEN = Finding(PhaseWrap(), 1.0, share=np.stack([np.full((2, 2), 0.25), np.full((2, 2), 0.125)]))
SOLVED: Any = SimpleNamespace(
    named=[SimpleNamespace(name=n, verdict=n, effects=(SimpleNamespace(ROUGH=rough),)) for n, rough in (("a", 0.04), ("b", 0.09))],
    sizes={"a": 3e-3, "b": 4e-3},
    names=lambda _: False,
    arms=np.ones((20, 6)),
    arms_sd=np.ones((20, 6)),
    evidence=(),
    cameras=np.tile(np.eye(4), (20, 1, 1)),
    chain=SimpleNamespace(station=np.zeros(20, int)),
)
CONFIG: Any = SimpleNamespace(report=ReportLimits(), select=SelectLimits(), noise=SimpleNamespace(foreign_light=ForeignLightLimits()))


@pytest.mark.parametrize(
    ("along", "left_out", "pushed"), [(1.0, (), False), (3.0, (), True), (3.0, ("interference",), True), (3.0, ("hand_eye",), False)]
)
def test_arms_that_err_along_the_view_alone_are_pushed(
    counted: list[Any], along: float, left_out: tuple[str, ...], *, pushed: bool
) -> None:
    """Where nothing explains it; without an arm, hand-eye is not considered, and its errors say nothing."""
    del counted
    arms = np.ones((20, 6)) * np.array([1, 1, along, 1, 1, 1])
    solved: Any = SimpleNamespace(**{**vars(SOLVED), "arms": arms})
    assert account(solved, CONFIG, NOTHING, left_out=frozenset(left_out)).pushed is pushed


@pytest.mark.parametrize(("left_out", "follows"), [((), True), (("hand_eye",), False)])
def test_arms_that_follow_the_views_are_stated(counted: list[Any], left_out: tuple[str, ...], *, follows: bool) -> None:
    del counted
    arms = np.random.default_rng(1).normal(0, 0.1, (20, 6))
    assert not account(SimpleNamespace(**{**vars(SOLVED), "arms": arms}), CONFIG, NOTHING).follows  # type: ignore[arg-type]
    arms[:, 2] += np.linspace(-1.0, 1.0, 20)
    solved: Any = SimpleNamespace(**{**vars(SOLVED), "arms": arms})
    assert account(solved, CONFIG, NOTHING, left_out=frozenset(left_out)).follows is follows
    assert not account(solved, CONFIG, NOTHING, alone=True).follows, "too few views"


def test_a_cause_is_what_it_does_alone_and_what_is_left_without_it(counted: list[Any]) -> None:
    found = account(SOLVED, CONFIG, NOTHING)
    assert [(c.named.name, c.alone.shrink, c.left_out, c.size_m) for c in found.causes] == [("a", 0.6, 0.2, 3e-3), ("b", 0.2, 0.6, 4e-3)]
    assert found.gap.shrink == 0.7
    assert found.findings == (FOUND,) == counted[0]


def test_what_was_found_before_depth_was_fitted_belongs_to_the_residual(counted: list[Any]) -> None:
    found = account(SOLVED, CONFIG, NOTHING, given=(GIVEN, FOUND), along_ray=RAY)
    assert found.findings == (GIVEN, FOUND, RAY, FOUND)
    np.testing.assert_array_equal(found.figures.residual[0], np.full((2, 2), 0.75))
    np.testing.assert_array_equal(found.figures.residual[1], np.full((2, 2), 1.625))
    only = account(SOLVED, CONFIG, NOTHING, given=(GIVEN,), alone=True)
    assert only.findings == (GIVEN,)
    assert account(SOLVED, CONFIG, NOTHING, alone=True).findings == ()


@pytest.mark.parametrize(
    ("findings", "names", "states"), [((FOUND,), [], False), ((), [], True), ((FOUND,), ["a"], True), ((), ["a"], True)]
)
def test_noise_and_loss_alone_shrink_no_bias(counted: list[Any], findings: tuple[Finding, ...], names: list[str], *, states: bool) -> None:
    made = account(SOLVED, CONFIG, NOTHING).figures
    gap = _gap(made, findings, names)
    assert (gap.shrink is not None) is states
    assert (gap.ci95 is not None) is states


def test_sizes_of_named_effects_add_in_squares() -> None:
    assert _named_m(SOLVED) == pytest.approx(5e-3)
    assert rough_m(SOLVED) == pytest.approx(np.sqrt(0.04 * 9e-6 + 0.09 * 16e-6))


LINES_M = 1e-4
FIELDS: Any = SimpleNamespace(field_share=0.1)


def detectors(monkeypatch: pytest.MonkeyPatch, **given: Any) -> dict[str, Any]:
    """Each detector says what is given; what they were told is kept."""
    told: dict[str, Any] = {}

    def says(name: str, default: Any) -> Any:
        def ask(*args: Any, **more: Any) -> Any:
            told[name] = (*args, *more.values())
            return given.get(name, default)

        return ask

    monkeypatch.setattr(noise, "without_noisy_pixels", lambda views, limits: views)
    monkeypatch.setattr(detected, "detected_effects", says("light", []))
    monkeypatch.setattr(detected, "explained", lambda left, light: (left, light))
    monkeypatch.setattr(room, "foreign_light", says("foreign", None))
    monkeypatch.setattr(room, "foreign_lamp", says("lamp", None))
    monkeypatch.setattr(missing, "missing_effects", says("gone", []))
    monkeypatch.setattr(noise, "noise_effects", says("noise", []))
    monkeypatch.setattr(room, "repeated", says("repeated", False))
    monkeypatch.setattr(room, "as_captures_step", lambda found, views, _limits: replace(found, note=f"steps of {views} views"))
    monkeypatch.setattr(room, "steps2", lambda _solved: 4e-6)
    monkeypatch.setattr(noise, "lines_found", lambda _views, _limits: given.get("lines", ["rows"]))
    monkeypatch.setattr(noise, "beside_lines", lambda views, lines: (views, "beside", *lines))
    monkeypatch.setattr(noise, "smooth_by_lines", lambda _views, lines, _limits: LINES_M * len(lines))
    return told


def findings_of(*, motion: bool = False, follows: bool = False, left_out: frozenset[str] = frozenset()) -> tuple[Finding, ...]:
    solved: Any = SimpleNamespace(
        **{
            **vars(SOLVED),
            "bare": "bare",
            "caster": "caster",
            "arms": "arms",
            "arms_sd": "sd",
            "camera_covs": "covs",
            "names": lambda name: motion and name == Motion.NAME,
        }
    )
    config: Any = SimpleNamespace(
        noise=SimpleNamespace(foreign_light=FIELDS, foreign_lamp="lamp", repeated=2.0),
        missing=MissingLimits(),
        report=ReportLimits(),
        select=SelectLimits(),
        stated_mhz=(),
    )
    return _findings(solved, config, NOTHING_STATED, left_out, follows=follows)


LIGHT = Finding(Interference(burst_m=0.001), 0.9, posed_m=2e-3)


def test_foreign_light_is_a_finding_that_noise_does_not_name_again(monkeypatch: pytest.MonkeyPatch) -> None:
    told = detectors(monkeypatch, foreign=LIGHT, noise=[FOUND])
    assert findings_of() == (LIGHT, FOUND)
    assert told["foreign"] == ("bare", "arms", "sd", "covs", FIELDS, pytest.approx(5e-3), LINES_M)
    assert told["noise"][2] == {"interference"}
    assert told["noise"][-1] == pytest.approx(5e-4), "a tenth of what is named may be left in a view"
    told = detectors(monkeypatch, noise=[FOUND])
    assert findings_of() == (FOUND,)
    assert told["noise"][2] == frozenset()
    told = detectors(monkeypatch, foreign=LIGHT)
    assert findings_of(follows=True) == (), "arm errors that follow the views"
    assert "foreign" not in told


def test_foreign_light_has_the_size_of_a_capture_s_steps_but_beside_rows_which_make_steps_too(monkeypatch: pytest.MonkeyPatch) -> None:
    detectors(monkeypatch, foreign=LIGHT, lines=[])
    (found,) = findings_of()
    assert found.note == "steps of bare views"
    detectors(monkeypatch, foreign=LIGHT)
    assert findings_of() == (LIGHT,)


def test_foreign_light_that_the_captures_of_a_dwell_share_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    told = detectors(monkeypatch, foreign=LIGHT, repeated=True)
    assert findings_of() == ()
    assert told["repeated"] == ("bare", LIGHT.common, 2.0, 4e-6), "steps of the camera count as well"
    assert told["noise"][2] == frozenset()


@pytest.mark.parametrize(
    ("effect", "piled_up"),
    [(AmplitudeBias(form="direct", direct_m=-0.01), True), (AmplitudeBias(form="direct"), False), (AmplitudeBias(per_ln_m=0.01), False)],
)
def test_noise_is_judged_beside_photons_that_hide_later_ones(
    monkeypatch: pytest.MonkeyPatch, effect: AmplitudeBias, *, piled_up: bool
) -> None:
    told = detectors(monkeypatch)
    monkeypatch.setattr(SOLVED, "named", [*SOLVED.named, SimpleNamespace(name="amplitude_bias", effects=(effect,))])
    monkeypatch.setattr(SOLVED, "sizes", {**SOLVED.sizes, "amplitude_bias": 1e-3})
    findings_of()
    assert told["noise"][-2] is piled_up


@pytest.mark.parametrize(("posed_m", "named"), [(1.33e-3, False), (1.35e-3, True)])
def test_foreign_light_must_exceed_what_inexact_maps_leave(monkeypatch: pytest.MonkeyPatch, posed_m: float, *, named: bool) -> None:
    """Roots of 4 and 9 % of 3 and 4 mm together: 1.34 mm."""
    light = Finding(Interference(burst_m=0.001), 0.9, posed_m=posed_m)
    detectors(monkeypatch, foreign=light)
    assert findings_of() == ((light,) if named else ())


@pytest.mark.parametrize(
    ("motion", "left_out"),
    [(True, frozenset()), (False, frozenset({"interference"})), (False, frozenset({"hand_eye"})), (True, frozenset({"hand_eye"}))],
)
def test_arm_errors_say_nothing_of_light_unshared_motion_and_without_an_arm(
    monkeypatch: pytest.MonkeyPatch, left_out: frozenset[str], *, motion: bool
) -> None:
    told = detectors(monkeypatch, foreign=LIGHT)
    assert findings_of(motion=motion, left_out=left_out) == ()
    assert "foreign" not in told
    assert told["gone"][-3] is motion
    assert ("lamp" in told) is ("interference" not in left_out)


@pytest.mark.parametrize(("foreign", "posed_m"), [(None, 0.0), (LIGHT, 2e-3)])
def test_a_lamp_whose_place_is_known_is_the_foreign_light(monkeypatch: pytest.MonkeyPatch, foreign: Any, posed_m: float) -> None:
    named = Finding(Interference(burst_m=0.004), 0.95)
    lamp = SimpleNamespace(
        finding=lambda views, limits, of_m: replace(named, posed_m=of_m) if (views, limits) == ("bare", FIELDS) else None
    )
    told = detectors(monkeypatch, foreign=foreign, lamp=lamp)
    (found,) = findings_of()
    assert (found.effect, found.posed_m) == (named.effect, posed_m)
    assert told["noise"][2] == {"interference"}


def test_what_a_filter_removed_is_no_loss_and_failed_merging_is_told_to_noise(monkeypatch: pytest.MonkeyPatch) -> None:
    """Foreign light beside frequencies that are merged wrongly cannot be told from their noise."""
    own = Finding(Noise(extra_m=0.002), 0.9, own_noise=np.ones((2, 2), bool))
    removed = Finding(PhaseWrap(), 0.6, holes=(np.eye(2, dtype=bool),), lost=0.5)
    kept = Finding(PhaseWrap(share=0.9), 0.9, corrects=True)
    for gone, scatter, unmerged, expected in (
        ([removed], [own], True, (own,)),
        ([removed], [FOUND], True, (FOUND, removed)),
        ([kept], [own], False, (own, kept)),
        ([], [own], False, (own,)),
    ):
        told = detectors(monkeypatch, gone=gone, noise=scatter, light=[])
        assert findings_of() == expected
        assert told["noise"][-3] is unmerged
        assert ("light" in told) is not unmerged


@pytest.mark.parametrize(("structured", "share", "is_doubted"), [(True, 0.01, True), (True, -0.01, False), (False, 0.5, False)])
def test_much_that_is_structured_and_unexplained_is_doubt(structured: bool, share: float, is_doubted: bool) -> None:  # noqa: FBT001
    limits = ReportLimits()
    left: Any = SimpleNamespace(structured=structured, share=limits.unexplained.doubt + share)
    assert doubted(left, limits) is is_doubted


@pytest.mark.parametrize("suspected", [False, True])
def test_a_confidence_is_the_share_of_wins_times_that_of_such_names_that_were_right(*, suspected: bool) -> None:
    limits = ReportLimits()
    told: Any = SimpleNamespace(config=CONFIG, suspected=lambda _: suspected, unexplained=SimpleNamespace(share=0.2))
    cause: Any = SimpleNamespace(named=SimpleNamespace(confidence=0.9))
    right = limits.confidence.suspected if suspected else limits.confidence.asserted * 0.8
    assert Diagnosis.confidence(told, cause) == pytest.approx(0.9 * right)


@pytest.mark.parametrize(("doubted", "few", "suspected"), [(False, False, False), (True, False, True), (False, True, True)])
def test_a_cause_is_suspected_where_much_is_unexplained_or_its_views_are_too_few(*, doubted: bool, few: bool, suspected: bool) -> None:
    told: Any = SimpleNamespace(doubted=doubted)
    cause: Any = SimpleNamespace(named=SimpleNamespace(suspected=few))
    assert Diagnosis.suspected(told, cause) is suspected


def test_pixels_share_their_product_with_those_in_other_rows_and_columns() -> None:
    """Squares of two pixels, in which each has one such partner, across; without a partner it is not known."""
    gone = np.nan
    values = np.array([[0.0, 1.0, 0.0, 0.0], [2.0, 5.0, 2.0, gone], [0.0, 1.0, 6.0, gone]])
    expected = [[0.0, 2.0, gone, 0.0], [2.0, 0.0, 0.0, gone], [gone, gone, gone, gone]]
    np.testing.assert_allclose(_shared(values, 2), expected)


@pytest.mark.parametrize(("known", "scale"), [(0.1, 1.1), (10.0, None)])
def test_the_noise_shown_by_all_views_together_is_bounded(known: float, scale: float | None) -> None:
    """Two views, of which one shows sixteen times its stated variance and one none: together eight times."""
    rng = np.random.default_rng(3)
    rough, flat = rng.normal(0, 4e-3, (30, 30)), np.zeros((30, 30))
    rough[0, 0] = np.nan
    stated = [np.full((30, 30), 1e-6)] * 2
    shown = shown2([rough, flat], stated, known, 4)
    assert np.all(shown[1][:28, :28] == 0.0)
    counts = np.isfinite(rough)
    together = (shown[0][counts].sum() + shown[1].sum()) / (counts.sum() + 900) / 1e-6
    assert together == pytest.approx(scale or together)
    if scale is None:
        np.testing.assert_allclose(shown[0][counts], (rough**2 - _shared(rough, 4))[counts])
    few = shown2([rough * 1e-3, flat], stated, 0.1, 4)
    assert (few[0][counts].sum() + few[1].sum()) / (counts.sum() + 900) / 1e-6 == pytest.approx(0.9)


def test_where_nothing_is_shown_the_stated_noise_stands() -> None:
    stated = [np.full((5, 5), 2.0)]
    np.testing.assert_array_equal(shown2([np.zeros((5, 5))], [np.zeros((5, 5))], 0.1, 4)[0], 0.0)
    assert shown2([np.full((5, 5), np.nan)], stated, 0.1, 4) == stated
