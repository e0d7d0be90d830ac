# SPDX-License-Identifier: Apache-2.0
"""Both sessions under the union of their effects: coefficients that differ are told from those that one diagnosis missed."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from tests.tof_gap.diagnosed import compared, diagnosis, only
from tests.tof_gap.quiet_views import views
from tof_gap.compare.difference import LACKS, WEAK
from tof_gap.compare.union import Fitted, apart, fitted, freed, members, moves_far, with_known
from tof_sensor.effects.amplitude_bias import AmplitudeBias
from tof_sensor.effects.depth_scale import DepthScale
from tof_sensor.effects.hand_eye import HandEye
from tof_sensor.effects.motion import Motion
from tof_sensor.effects.wiggling import Wiggling

if TYPE_CHECKING:
    from tof_gap.seen.evidence.view import ViewEvidence
    from tof_gap.tell.diagnosis import Diagnosis

WIGGLE = Wiggling(sine_m=0.006, modulation_mhz=90.0)
GAIN = 30.0


@pytest.fixture(scope="module")
def evidence() -> tuple[ViewEvidence, ...]:
    """Views of a plane with photon noise."""
    return views(np.random.default_rng(3))


def unnamed(session: Diagnosis) -> Diagnosis:
    """The same session, whose views contain its effects and whose diagnosis named none."""
    missed: tuple[Any, ...] = (session.causes, session.account.figures.maps)
    for one in missed:
        one.clear()
    return session


def test_a_difference_below_the_floor_of_the_distance_is_found_by_its_coefficients(evidence: tuple[ViewEvidence, ...]) -> None:
    """0.7 mm are no gap beside 5.5 mm of noise in each pixel; 36000 pixels know the wave's amplitude to a tenth."""
    small = replace(WIGGLE, sine_m=0.001)
    found = compared(diagnosis(evidence, small), diagnosis(evidence))
    assert found.distance.floor_mm == pytest.approx(5.5, abs=0.1)
    assert (found.distance.shrink, only(found).shrink) == (None, None)
    assert (only(found).effect, only(found).simulator) == ("wiggling", LACKS)
    assert only(found).real_mm == pytest.approx(1.0 / np.sqrt(2), rel=0.15)
    assert "once all effects below are put right" in found.lines()[1]
    assert "disappears" not in found.lines()[2]


@pytest.mark.parametrize(
    ("rough", "per_ln_m", "verdict"), [(0.0, 0.0010, "amplitude_bias"), (0.06, 0.0010, "none"), (0.06, 0.0040, "amplitude_bias")]
)
def test_beside_a_coarse_map_a_difference_exceeds_the_errors_of_that_map(
    evidence: tuple[ViewEvidence, ...], monkeypatch: pytest.MonkeyPatch, rough: float, per_ln_m: float, verdict: str
) -> None:
    """Both have waves of 4 mm, of whose map a share of 6 % of the energy is wrong in each session: 1 mm."""
    monkeypatch.setattr(Wiggling, "ROUGH", rough)
    small = AmplitudeBias(per_ln_m=per_ln_m, reference=2000.0)
    found = compared(diagnosis(evidence, WIGGLE), diagnosis(evidence, WIGGLE, small))
    assert found.verdict == (verdict,)
    assert list(found.within_maps) == (["amplitude_bias"] if verdict == "none" else [])
    assert ("may err: no difference" in found.lines()[-1]) == (verdict == "none")


def test_an_effect_that_one_diagnosis_missed_is_no_difference(evidence: tuple[ViewEvidence, ...]) -> None:
    found = compared(diagnosis(evidence, WIGGLE), unnamed(diagnosis(evidence, WIGGLE)))
    assert (found.verdict, found.alike) == (("none",), ("wiggling",))


def test_an_effect_that_one_diagnosis_missed_at_half_the_size_is_understated(evidence: tuple[ViewEvidence, ...]) -> None:
    found = compared(diagnosis(evidence, WIGGLE), unnamed(diagnosis(evidence, replace(WIGGLE, sine_m=0.003))))
    assert only(found).simulator == WEAK
    assert only(found).simulated_mm == pytest.approx(0.5 * only(found).real_mm, rel=0.1)
    assert only(found).parts["panel"] == pytest.approx(only(found).real_mm - only(found).simulated_mm, rel=1e-6)
    assert only(found).ratio == pytest.approx(2.0, rel=0.1)


def test_of_two_effects_that_look_alike_the_one_that_differs_is_freed() -> None:
    """The errors of both fits correlate by -0.9. Of a chi-square of 526, the second alone would explain 81 %, and nothing beside the first."""
    cov = 0.5 * np.array([[1.0, -0.9], [-0.9, 1.0]])
    found = freed(Fitted(np.array([20.0, 5.0]), cov), Fitted(np.array([10.0, 5.0]), cov), ["a", "b"], GAIN)
    assert {name: a.differs for name, a in found.items()} == {"a": True, "b": False}
    assert found["a"][:5] == pytest.approx((100 / 0.19, 400 / 0.19, 100 / 0.19, 200 / 0.19, 1.0))
    assert found["b"][:5] == pytest.approx((0.0, 25.0, 25.0, 25.0, 0.0), abs=1e-9)


def test_independent_differences_are_both_freed() -> None:
    found = freed(Fitted(np.array([20.0, 8.0]), 0.5 * np.eye(2)), Fitted(np.array([10.0, 0.0]), 0.5 * np.eye(2)), ["a", "b"], GAIN)
    assert all(a.differs for a in found.values())
    assert (found["a"].difference, found["a"].share) == pytest.approx((100.0, 100.0 / 164.0))
    assert (found["b"].difference, found["b"].share) == pytest.approx((64.0, 64.0 / 164.0))
    assert found["a"].ratio == pytest.approx(0.5)


def test_a_session_says_nothing_about_an_effect_that_it_cannot_show(evidence: tuple[ViewEvidence, ...]) -> None:
    """Without returned light, an effect of amplitude has a column of zeros: its coefficient is not known to be 0."""
    walk = AmplitudeBias(per_ln_m=0.004, reference=2000.0)
    bright = diagnosis(evidence, walk)
    dark = diagnosis(tuple(replace(v, frame=replace(v.frame, amplitude=0.0 * v.frame.amplitude)) for v in evidence))
    union = members((bright, dark), {}, 1.0, frozenset())
    assert union is not None
    coefficients, _ = fitted(dark, union, 1)
    assert np.all(coefficients.theta == 0.0)
    assert np.diag(coefficients.cov) == pytest.approx(1.0)
    assert not apart((bright, dark), union, GAIN)["amplitude_bias"].differs


def test_the_union_has_each_shape_once_and_no_effect_that_moves_the_camera(evidence: tuple[ViewEvidence, ...]) -> None:
    one, other = diagnosis(evidence, WIGGLE), diagnosis(evidence, replace(WIGGLE, sine_m=0.001), DepthScale(0.01))
    union = members((one, other), {"depth_scale": "wiggling"}, 1.0, frozenset())
    assert union is not None
    assert [(m.group, m.effect.NAME) for m in union] == [("wiggling", "wiggling"), ("wiggling", "depth_scale")]
    assert members((one, diagnosis(evidence, HandEye(z_m=0.02))), {}, 1.0, frozenset()) is None
    assert members((one, other), {}, 1.0, frozenset({"wiggling", "depth_scale"})) == []


@pytest.mark.parametrize(("late_s", "far"), [(0.0, False), (0.002, False), (0.200, True)])
def test_a_lateness_is_described_by_columns_up_to_half_a_pixel(evidence: tuple[ViewEvidence, ...], late_s: float, *, far: bool) -> None:
    """At 0.1 m/s and a metre, 100 pixels of focal length make 10 pixels per second."""
    twist = np.array([0.1, 0.0, 0.0, 0.0, 0.0, 0.0])
    moved = diagnosis(tuple(replace(v, frame=replace(v.frame, context=replace(v.frame.context, twist=twist))) for v in evidence))
    assert moves_far(Motion(axial_s=late_s), moved) is far
    assert not moves_far(Motion(axial_s=late_s), diagnosis(evidence)), "at rest nothing is late"
    assert moves_far(HandEye(z_m=0.001), moved)


def test_a_known_effect_is_in_both_sessions(evidence: tuple[ViewEvidence, ...]) -> None:
    """1 % of the depth was removed from both; the simulator without it shows the negative: in all 1 % and nothing."""
    plain, less = diagnosis(evidence), diagnosis(evidence, DepthScale(-0.01))
    union = members((plain, less), {}, 1.0, frozenset())
    assert union is not None
    found = apart((plain, less), with_known(union, [DepthScale(0.01), WIGGLE]), GAIN)["depth_scale"]
    assert found.real == pytest.approx(found.difference, rel=0.1)
    assert found.simulated < 0.01 * found.real


def test_an_effect_within_a_healthy_cameras_tolerance_is_still_in_the_session(evidence: tuple[ViewEvidence, ...]) -> None:
    """The camera's wave is named, the simulator's, a tenth less, is within the tolerance and subtracted from its views: both have it."""
    small = replace(WIGGLE, sine_m=0.0054)
    healthy = diagnosis(evidence)
    assert compared(diagnosis(evidence, WIGGLE), healthy).verdict == ("wiggling",)
    object.__setattr__(healthy.account.solved, "within", (SimpleNamespace(name="wiggling", effects=(small,)),))
    union = members((diagnosis(evidence, WIGGLE), healthy), {}, 1.0, frozenset())
    assert union is not None
    found = apart((diagnosis(evidence, WIGGLE), healthy), union, GAIN)["wiggling"]
    assert np.sqrt(found.simulated / found.real) == pytest.approx(0.9, abs=0.05)
    assert found.ratio < 0.3
