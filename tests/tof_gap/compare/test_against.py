# SPDX-License-Identifier: Apache-2.0
"""A simulator against a camera: effects lacking, superfluous, too weak, too strong, of another form, and nothing where they agree."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import pytest

from tests.tof_gap.diagnosed import compared, diagnosis, only
from tests.tof_gap.quiet_views import SHAPE, views
from tof_core.calibration import HandEyeLimits
from tof_gap.compare.against import against
from tof_gap.compare.comparison import undecided
from tof_gap.compare.difference import LACKS, OTHER, STRONG, SUPERFLUOUS, WEAK
from tof_gap.config import GapConfig
from tof_sensor.effects.amplitude_bias import AmplitudeBias
from tof_sensor.effects.depth_scale import DepthScale
from tof_sensor.effects.fixed_pattern import FixedPattern, packed
from tof_sensor.effects.hand_eye import HandEye
from tof_sensor.effects.wiggling import Wiggling
from tof_sensor.geometry import pose_columns
from tof_sensor.model import SensorModel

if TYPE_CHECKING:
    from tof_gap.seen.evidence.view import ViewEvidence
    from tof_gap.tell.diagnosis import Diagnosis

WIGGLE = Wiggling(sine_m=0.006, modulation_mhz=90.0)
WALK = AmplitudeBias(per_ln_m=0.004, reference=2000.0)


@pytest.fixture(scope="module")
def evidence() -> tuple[ViewEvidence, ...]:
    """Views of a plane with photon noise."""
    return views(np.random.default_rng(3))


def test_the_same_effects_are_no_difference(evidence: tuple[ViewEvidence, ...]) -> None:
    found = compared(diagnosis(evidence, WIGGLE, WALK), diagnosis(evidence, WIGGLE, WALK))
    assert found.verdict == ("none",)
    assert found.distance.shrink is None
    assert (found.lines()[1], found.alike) == ("the simulator has the camera's effects", ("amplitude_bias", "wiggling"))
    assert found.lines()[-1] == "both have wiggling (4.02 mm real, 4.02 mm simulated): no difference"
    assert found.to_dict()["alike_mm"]["wiggling"] == pytest.approx([4.02, 4.02], abs=0.01)


def test_two_sessions_without_an_effect_are_said_to_show_none(evidence: tuple[ViewEvidence, ...]) -> None:
    found = compared(diagnosis(evidence), diagnosis(evidence))
    assert (found.verdict, found.alike) == (("none",), ())
    assert found.lines()[-1] == "simulator and camera differ in no effect: neither shows one"


def test_an_effect_of_one_verdict_that_no_difference_settles_is_said() -> None:
    sides = ("motion", "noise"), ("noise",)
    assert undecided(sides, (), frozenset()) == {"motion": "camera"}
    assert undecided(sides[::-1], (), frozenset()) == {"motion": "simulator"}
    assert undecided(sides, (), {"motion"}) == {}
    assert undecided((("none",), ("unknown",)), (), frozenset()) == {}


@pytest.mark.parametrize("other", ["temperature_drift", "range_offset"])
def test_a_tie_is_settled_by_either_of_its_effects(other: str) -> None:
    tie = "range_offset|temperature_drift"
    assert undecided(((tie,), (other,)), (), frozenset()) == {}
    assert undecided(((tie,), ()), (), {other}) == {}
    assert undecided(((tie,), ()), (), frozenset()) == {tie: "camera"}


def test_an_open_effect_is_no_difference_and_no_agreement(evidence: tuple[ViewEvidence, ...]) -> None:
    quiet = diagnosis(evidence)
    found = replace(compared(quiet, quiet), undecided={"flying_pixels": "camera"})
    assert found.verdict == ("none",)
    assert found.head()[-1] == "no effect is certain enough to be named as a difference"
    assert found.foot()[0] == (
        "flying pixels was found in the camera's bag alone, and the simulator's does not tell whether it lacks it: no difference. "
        "More views make it certain"
    )
    assert found.to_dict()["undecided"] == {"flying_pixels": "camera"}


def unsure(evidence: tuple[ViewEvidence, ...], left_mm: float) -> Diagnosis:
    """A session with wiggling of which nothing is certain: its own verdict is `unknown`, and so much is left above its noise."""
    found = diagnosis(evidence, WIGGLE)
    found.verdict = ("unknown",)  # type: ignore[misc]
    found.doubted = True  # type: ignore[misc]
    found.gap = SimpleNamespace(shown_mm=(left_mm, left_mm), shrink=None, ci95=None)  # type: ignore[misc,assignment]
    return found


def test_a_session_of_unknown_errors_leaves_the_comparison_unknown(evidence: tuple[ViewEvidence, ...]) -> None:
    """4 mm of wiggling that the camera's diagnosis only suspects: the simulator without it is not said to be right."""
    for real, simulated, side in (
        (unsure(evidence, 4.0), diagnosis(evidence), "camera"),
        (diagnosis(evidence), unsure(evidence, 4.0), "simulator"),
    ):
        found = compared(real, simulated)
        assert (found.verdict, found.differences) == (("unknown",), ())
        assert found.lines()[1] == "no effect is certain enough to be named as a difference"
        assert f"the {side}'s bag has errors of 4.00 mm RMS without a certain cause; suspected: wiggling" in found.lines()[2]
        assert found.to_dict()["unknown"] == {side: {"rms_mm": 4.0, "suspected": ["wiggling"]}}


def test_unknown_errors_of_a_healthy_cameras_size_leave_nothing_open(evidence: tuple[ViewEvidence, ...]) -> None:
    found = compared(unsure(evidence, 0.9), diagnosis(evidence))
    assert (found.verdict, found.to_dict()["unknown"]) == (("none",), {})


def test_beside_unknown_errors_a_certain_difference_is_listed(evidence: tuple[ViewEvidence, ...]) -> None:
    found = compared(unsure(evidence, 4.0), diagnosis(evidence, DepthScale(0.01)))
    assert (found.verdict, only(found).simulator) == (("depth_scale", "unknown"), SUPERFLUOUS)


def test_what_the_simulators_bag_cannot_test_is_said_once_for_each_reason(evidence: tuple[ViewEvidence, ...]) -> None:
    simulated = diagnosis(evidence)
    simulated.not_testable.update(
        {"amplitude_bias": "no amplitude image", "lens_scatter": "no amplitude image", "noise": "no amplitude image"}
    )
    found = compared(diagnosis(evidence), simulated)
    assert found.lines()[-1] == "not testable in the simulator's bag: amplitude_bias, lens_scatter (no amplitude image)"
    assert sorted(found.to_dict()["not_testable"]) == ["amplitude_bias", "lens_scatter"], "noise is compared by another way"


def test_a_missing_effect_is_lacking_and_closes_the_distance(evidence: tuple[ViewEvidence, ...]) -> None:
    found = compared(diagnosis(evidence, WIGGLE, WALK), diagnosis(evidence, WALK))
    assert found.verdict == ("wiggling",)
    assert only(found).simulator == LACKS
    assert only(found).shrink == pytest.approx(1.0, abs=0.05)
    assert only(found).parts["panel"] == pytest.approx(only(found).real_mm, rel=1e-6)
    assert only(found).real_mm == pytest.approx(6.0 / np.sqrt(2), rel=0.15)


def test_an_effect_that_reality_has_not_is_superfluous(evidence: tuple[ViewEvidence, ...]) -> None:
    found = compared(diagnosis(evidence, WALK), diagnosis(evidence, WALK, DepthScale(0.01)))
    assert (found.verdict, only(found).simulator) == (("depth_scale",), SUPERFLUOUS)
    assert only(found).simulated_mm > 5.0 > only(found).real_mm


def test_size_and_form_are_distinguished(evidence: tuple[ViewEvidence, ...]) -> None:
    real = diagnosis(evidence, WIGGLE)
    half, twice, other = (Wiggling(sine_m=s, cosine_m=c, modulation_mhz=90.0) for s, c in ((0.003, 0.0), (0.012, 0.0), (0.0, 0.006)))
    assert [only(compared(real, diagnosis(evidence, e))).simulator for e in (half, twice, other)] == [WEAK, STRONG, OTHER]


def test_a_size_that_makes_most_of_the_difference_is_named_before_the_form(evidence: tuple[ViewEvidence, ...]) -> None:
    """Two waves a quarter of a turn and less apart: of one size they differ in form, of twice the size in size first."""
    real, turn = diagnosis(evidence, WIGGLE), np.radians(35.0)
    equal, twice = (
        Wiggling(sine_m=size * float(np.cos(turn)), cosine_m=size * float(np.sin(turn)), modulation_mhz=90.0) for size in (0.006, 0.012)
    )
    assert [only(compared(real, diagnosis(evidence, e))).simulator for e in (equal, twice)] == [OTHER, STRONG]
    assert only(compared(diagnosis(evidence, twice), real)).simulator == WEAK


def test_each_effect_takes_its_share_of_the_distance(evidence: tuple[ViewEvidence, ...]) -> None:
    found = compared(diagnosis(evidence, WIGGLE, WALK), diagnosis(evidence))
    assert found.verdict == ("amplitude_bias", "wiggling")
    assert sum(d.shrink or 0.0 for d in found.differences) == pytest.approx(1.0, abs=0.25)
    assert found.distance.shrink == pytest.approx(1.0, abs=0.05)


def test_a_camera_off_its_mount_is_compared_as_it_is_rendered(evidence: tuple[ViewEvidence, ...], monkeypatch: pytest.MonkeyPatch) -> None:
    """The camera's own map is rendered; to first order the simulator's would differ from it by a fifth."""
    seen = tuple(replace(v, frame=replace(v.frame, context=replace(v.frame.context, caster=cast("Any", "the scene")))) for v in evidence)
    moved = HandEye(z_m=0.020)
    monkeypatch.setattr("tof_gap.compare.maps.rendered_bias", lambda effect, view, *_: 1.2 * effect.bias(view.frame))
    real = diagnosis(seen, HandEye(z_m=0.024))
    assert compared(real, diagnosis(seen, moved)).verdict == ("none",)
    assert compared(real, diagnosis(seen, HandEye(z_m=0.010))).verdict == ("hand_eye",)


@pytest.mark.parametrize(
    ("most_mm", "z_m", "verdict", "as_stated"),
    [
        (2.0, (0.024, 0.010), ("hand_eye",), ()),
        (2.0, (0.024, 0.020), ("hand_eye",), ()),
        (0.0, (0.024, 0.020), ("none",), ()),
        (15.0, (0.024, 0.010), ("none",), ("hand_eye",)),
    ],
)
def test_mounts_that_differ_by_no_more_than_the_stated_calibration_are_alike(
    evidence: tuple[ViewEvidence, ...],
    monkeypatch: pytest.MonkeyPatch,
    most_mm: float,
    z_m: tuple[float, float],
    verdict: tuple[str, ...],
    as_stated: tuple[str, ...],
) -> None:
    """Each session knows its own mount to 0.5 mm. 24 and 20 mm differ by too little for their size, and by more than a calibration to 2 mm."""
    seen = tuple(replace(v, frame=replace(v.frame, context=replace(v.frame.context, caster=cast("Any", "the scene")))) for v in evidence)
    monkeypatch.setattr("tof_gap.compare.maps.rendered_bias", lambda effect, view, *_: effect.bias(view.frame))
    calibration = replace(GapConfig().calibration, hand_eye=HandEyeLimits(translation_mm=most_mm, rotation_deg=0.2 if most_mm else 0.0))
    sides = [diagnosis(seen, HandEye(z_m=z), std=5e-4) for z in z_m]
    for side in sides:
        side.config = replace(GapConfig(), calibration=calibration)  # type: ignore[misc]
    found = compared(*sides)
    assert (found.verdict, found.as_stated) == (verdict, as_stated)
    lines = [f"{name} differs by no more than the stated calibration: no difference" for name in as_stated]
    assert found.lines()[-len(lines) :] == lines if lines else "stated calibration" not in "".join(found.lines())
    assert found.to_dict()["as_stated"] == list(as_stated)


def test_what_is_only_suspected_is_no_effect_of_the_camera(evidence: tuple[ViewEvidence, ...]) -> None:
    sure = diagnosis(evidence, WIGGLE)
    assert compared(sure, diagnosis(evidence)).verdict == ("wiggling",)
    sure.doubted = True  # type: ignore[misc]
    assert compared(sure, diagnosis(evidence)).verdict == ("none",)


@pytest.mark.parametrize(("noise_m", "verdict"), [(0.0, "fixed_pattern"), (0.0030, "none")])
def test_two_patterns_differ_by_the_noise_of_their_fits(evidence: tuple[ViewEvidence, ...], noise_m: float, verdict: str) -> None:
    """Two fits of one pattern, each with 3 mm of noise in every pixel: known to be so noisy they are one pattern."""
    rng = np.random.default_rng(0)
    one, other = (diagnosis(evidence, FixedPattern(pixels=packed(rng.normal(0.0, 0.0030, SHAPE)))) for _ in range(2))
    for found in (one, other):
        object.__setattr__(found.account.figures, "unsure2", np.full(SHAPE, noise_m**2))
    assert compared(one, other).verdict == (verdict,)


def test_a_tie_is_the_effect_of_the_other_session(evidence: tuple[ViewEvidence, ...]) -> None:
    tied, sure = diagnosis(evidence, DepthScale(0.01), ties=("wiggling",)), diagnosis(evidence, WIGGLE)
    found = compared(tied, sure)
    assert (only(found).effect, only(found).simulator) == ("depth_scale", OTHER)
    assert found.verdict == ("depth_scale|wiggling",), (
        "the compared name is ruled out by the simulator's session, the other one is not fitted"
    )
    mirrored = compared(sure, tied)
    assert (only(mirrored).effect, only(mirrored).simulator) == ("wiggling", OTHER)
    assert mirrored.verdict == ("wiggling",), "the camera's session rules the depth scale out"


def test_a_difference_is_stated_with_the_tie_of_the_session_that_has_it(evidence: tuple[ViewEvidence, ...]) -> None:
    tied = diagnosis(evidence, WIGGLE, ties=("depth_scale",))
    lacking, more = compared(tied, diagnosis(evidence)), compared(diagnosis(evidence), tied)
    assert lacking.verdict == more.verdict == ("depth_scale|wiggling",)
    assert only(lacking).sentence == "the simulator lacks depth scale or wiggling"
    assert only(more).sentence == "the simulator has depth scale or wiggling, and the camera has not"
    (row,) = lacking.to_dict()["differences"]
    assert (row["effect"], row["tied_with"]) == ("wiggling", ["depth_scale"])
    assert only(lacking).todo == "give the simulator the wiggling of sensor.yaml"


def test_of_an_effect_that_both_sessions_name_the_tie_is_what_neither_rules_out(evidence: tuple[ViewEvidence, ...]) -> None:
    once = diagnosis(evidence, WIGGLE, ties=("depth_scale", "range_offset"))
    twice = diagnosis(evidence, replace(WIGGLE, sine_m=0.012), ties=("range_offset",))
    assert compared(once, twice).verdict == ("range_offset|wiggling",)
    assert compared(once, diagnosis(evidence, replace(WIGGLE, sine_m=0.012))).verdict == ("wiggling",)


def test_an_effect_that_the_poses_of_one_session_took_up_is_no_difference(evidence: tuple[ViewEvidence, ...]) -> None:
    """The camera's diagnosis missed the wiggling and moved its poses instead; the simulator's found it."""
    waves = replace(WIGGLE, modulation_mhz=150.0)
    missed, found = diagnosis(evidence), diagnosis(evidence, waves)
    moved = []
    for v, r in zip(evidence, found.account.figures.residual, strict=True):
        seen, P = np.isfinite(r), pose_columns(v.frame)
        moved.append(r - P @ np.linalg.lstsq(P[seen], r[seen], rcond=None)[0])
    object.__setattr__(missed.account.figures, "residual", moved)
    assert compared(missed, found).verdict == ("none",)
    result = compared(found, missed)
    assert (result.verdict, result.alike) == (("none",), ("wiggling",))
    assert "found in one bag alone, and the views of both show it alike" in result.lines()[-1]


def test_two_fits_of_one_effect_are_no_difference(evidence: tuple[ViewEvidence, ...]) -> None:
    """They differ by a fifth, and by half of the distance that is left."""
    fits = [diagnosis(evidence, replace(WIGGLE, sine_m=size)) for size in (0.0120, 0.0096)]
    assert compared(*fits).verdict == ("none",)


def test_units_of_amplitude_are_told_apart_only_beyond_the_error_of_albedos(evidence: tuple[ViewEvidence, ...]) -> None:
    """A unit that seems to be 1.45 times the camera's may be an error of the stated albedo; ten times is another unit."""
    late = AmplitudeBias(form="inverse", inverse_m=0.004, reference=2000.0)
    for times, verdict in ((1.45, ("amplitude_bias",)), (10.0, ("none",))):
        brighter = tuple(
            replace(
                v,
                view=replace(v.view, amplitude=times * cast("Any", v.view.amplitude)),
                frame=replace(v.frame, amplitude=times * v.frame.amplitude),
            )
            for v in evidence
        )
        simulated = replace(late, reference=times * late.reference)
        assert compared(diagnosis(evidence, late), diagnosis(brighter, simulated)).verdict == verdict


def test_what_was_removed_from_both_sessions_is_in_both(evidence: tuple[ViewEvidence, ...]) -> None:
    """With --sensor a simulator without a known effect shows the negative of this effect."""
    known = SensorModel((DepthScale(0.01),))
    plain, less = diagnosis(evidence), diagnosis(evidence, DepthScale(-0.01))
    same, lacking = (against(plain, d, ("panel",), None, known) for d in (plain, less))
    assert same.verdict == ("none",)
    assert (lacking.verdict, only(lacking).simulator) == (("depth_scale",), LACKS)
    assert only(lacking).real_mm > 5.0 > only(lacking).simulated_mm


def test_each_difference_says_what_to_do(evidence: tuple[ViewEvidence, ...]) -> None:
    real = diagnosis(evidence, WIGGLE)
    twice = only(compared(real, diagnosis(evidence, replace(WIGGLE, sine_m=0.012))))
    assert (twice.sentence, twice.todo) == ("the simulator exaggerates wiggling", "give wiggling 0.5 times its size in the simulator")
    lacking, more = only(compared(real, diagnosis(evidence))), only(compared(diagnosis(evidence), real))
    assert lacking.todo == "give the simulator the wiggling of sensor.yaml"
    assert more.todo == "take wiggling out of the simulator"
