# SPDX-License-Identifier: Apache-2.0
"""Second selection at the final poses: a difference is found by an effect that neither diagnosis named."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from tests.tof_gap.diagnosed import compared, diagnosis, only
from tests.tof_gap.quiet_views import SHAPE, views
from tof_gap.compare.against import against
from tof_gap.compare.difference import LACKS, SUPERFLUOUS
from tof_gap.compare.second import AsFitted
from tof_gap.solve.hypotheses.candidate import Candidate
from tof_sensor.effects.hand_eye import HandEye
from tof_sensor.effects.intrinsics import Intrinsics
from tof_sensor.effects.range_offset import RangeOffset
from tof_sensor.effects.temperature_drift import TemperatureDrift
from tof_sensor.effects.time_sync import TimeSync
from tof_sensor.effects.wiggling import Wiggling

if TYPE_CHECKING:
    from tof_gap.seen.evidence.view import ViewEvidence
    from tof_gap.tell.diagnosis import Diagnosis
    from tof_sensor.effect import Effect

WAVE = Wiggling(modulation_mhz=90.0)
TRIED = (WAVE, RangeOffset(), Intrinsics(), TimeSync())


@pytest.fixture(scope="module")
def evidence() -> tuple[ViewEvidence, ...]:
    """Views of a plane with photon noise, in some scene."""
    scene: Any = SimpleNamespace(scene=None)
    found = views(np.random.default_rng(3))
    return tuple(replace(v, frame=replace(v.frame, context=replace(v.frame.context, caster=scene))) for v in found)


@pytest.fixture(autouse=True)
def tried(monkeypatch: pytest.MonkeyPatch) -> None:
    """The forms that a session asks to try."""
    left: Any = lambda _views, _scene, _noise, left_out, **_: [Candidate(e.NAME, e) for e in TRIED if e.NAME not in left_out]  # noqa: E731
    monkeypatch.setattr("tof_gap.compare.second.candidates", left)


def missed(evidence: tuple[ViewEvidence, ...], *effects: Effect) -> Diagnosis:
    """A session whose views contain effects of which the diagnosis named none."""
    found = diagnosis(evidence, *effects)
    emptied: tuple[Any, ...] = (found.causes, found.account.figures.maps)
    for one in emptied:
        one.clear()
    return found


def wave(size_m: float) -> Wiggling:
    return replace(WAVE, sine_m=size_m)


def test_an_effect_that_no_diagnosis_named_is_found_in_the_session_that_has_it(evidence: tuple[ViewEvidence, ...]) -> None:
    has, without = missed(evidence, wave(0.006)), diagnosis(evidence)
    lacking, more = (only(compared(*pair)) for pair in ((has, without), (without, has)))
    assert [(d.effect, d.simulator) for d in (lacking, more)] == [("wiggling", LACKS), ("wiggling", SUPERFLUOUS)]
    assert (lacking.real_mm, lacking.simulated_mm) == (pytest.approx(6.0 / np.sqrt(2), rel=0.1), 0.0)
    assert (more.real_mm, more.simulated_mm) == (0.0, pytest.approx(lacking.real_mm, rel=1e-6))


def test_an_effect_that_both_sessions_have_is_no_difference(evidence: tuple[ViewEvidence, ...]) -> None:
    assert compared(missed(evidence, wave(0.006)), missed(evidence, wave(0.006))).verdict == ("none",)


def test_errors_as_small_as_a_healthy_cameras_are_not_added(evidence: tuple[ViewEvidence, ...]) -> None:
    """0.6 mm RMS, which 36000 pixels show beyond doubt; a diagnosis names 1 mm."""
    assert compared(missed(evidence, wave(0.0009)), diagnosis(evidence)).verdict == ("none",)
    assert compared(missed(evidence, wave(0.0018)), diagnosis(evidence)).verdict == ("wiggling",)


def test_nothing_is_added_beside_errors_without_a_name(evidence: tuple[ViewEvidence, ...]) -> None:
    has, without = missed(evidence, wave(0.006)), diagnosis(evidence)
    without.unexplained.structured = True  # type: ignore[misc]
    assert compared(has, without).verdict == ("none",)


def test_what_is_left_out_is_not_added(evidence: tuple[ViewEvidence, ...]) -> None:
    has, without = missed(evidence, wave(0.006)), diagnosis(evidence)
    assert against(has, without, ("panel",), left_out=frozenset({"wiggling"})).verdict == ("none",)
    has.not_testable["wiggling"] = without.not_testable["wiggling"] = "the session spans too little range"
    assert compared(has, without).verdict == ("none",)


def test_effects_that_move_the_camera_are_not_tried(evidence: tuple[ViewEvidence, ...], monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[str] = []

    def designed(_session: Any, union: Any, _side: int, _names: Any) -> Any:
        seen.extend(m.group for m in union)
        return None, None

    monkeypatch.setattr("tof_gap.compare.second.designed", designed)
    monkeypatch.setattr("tof_gap.compare.second.added", lambda *_: ())
    compared(diagnosis(evidence), diagnosis(evidence))
    assert seen == ["wiggling", "range_offset"] * 2
    assert HandEye.NAME not in seen


def test_a_drift_is_not_extrapolated_beyond_the_temperatures_of_its_session(evidence: tuple[ViewEvidence, ...]) -> None:
    """30 mm/K over the 0.1 K of one session; the other was recorded 3.6 K warmer."""
    drift = TemperatureDrift(drift_m=0.030, reference_c=29.0)
    frame = replace(evidence[0].frame, context=replace(evidence[0].frame.context, temperature=32.6))
    along = AsFitted(drift, (1.0, 1.0), (29.0, 29.1)).bias(frame, 0) * frame.length
    assert along[SHAPE[0] // 2, SHAPE[1] // 2] == pytest.approx(0.003, rel=1e-3)
