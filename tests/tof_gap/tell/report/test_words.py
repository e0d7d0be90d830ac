# SPDX-License-Identifier: Apache-2.0
"""The words of the report: what to do now, and sizes of effects."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tof_core.calibration import AlbedoLimits, Calibration, HandEyeLimits, LensLimits, Modulation
from tof_core.se3 import exp
from tof_gap.seen.finding import Finding
from tof_gap.tell.report.words import (
    calibration_words,
    doubt_words,
    expected_words,
    hand_eye_words,
    most_pixels,
    sentence,
    size_in_words,
    small_words,
    todo,
    untested_words,
)
from tof_sensor.effects.dropout import Dropout
from tof_sensor.effects.interference import Interference
from tof_sensor.effects.quantization import Quantization
from tof_sensor.session import Course


def cause(effect: str, **params: Any) -> dict[str, Any]:
    return {"effect": effect, "params": params, "params_std": {}}


@pytest.mark.parametrize(
    ("found", "words"),
    [
        (cause("wiggling", sine_m=3e-3, cosine_m=-4e-3, modulation_mhz=100.0, harmonic=4), "±5.0 mm every 0.37 m of range"),
        (cause("range_offset", offset_m=-0.0042), "-4.2 mm"),
        (
            cause("temperature_drift", drift_m=4e-4, warmup_m=-0.0031, housing_m=0.0, tau_s=210.0, housing_s=0.0),
            "from -3.1 mm at the start to +1.4 mm after 10.0 min",
        ),
        (cause("temperature_drift", drift_m=4e-4, tau_s=0.0), "+0.4 mm a kelvin of the thermometer"),
        (
            cause("temperature_drift", drift_share=1e-3, warmup_share=-0.01, tau_s=210.0, gain=True),
            "from -1.00 % of the range at the start to +0.34 % of the range after 10.0 min",
        ),
        (cause("depth_scale", scale=0.004), "+0.40 %"),
        (cause("quantization", step_m=0.005), "steps of 5.0 mm"),
        (
            cause(
                "wiggling",
                a={"sine_m": 5e-3, "modulation_mhz": 100.0, "harmonic": 4},
                b={"sine_m": 2e-3, "modulation_mhz": 50.0, "harmonic": 4},
            ),
            "±5.0 mm every 0.37 m of range, and ±2.0 mm every 0.75 m of range",
        ),
        (cause("multipath", strength=0.8), ""),
        (cause("cad_deviation", panel={"x": 1.0}, rib={"x": 2.0}), ""),
    ],
)
def test_a_size_is_in_words_where_there_are_some(found: dict[str, Any], words: str) -> None:
    assert size_in_words(found, Course(600.0, 25.0, 29.0)) == words


@pytest.mark.parametrize(
    ("session_s", "words"),
    [
        (
            1500.0,
            "from +4.8 mm at the start to +2.2 mm after 25.0 min",
        ),
        (
            600.0,
            "by -0.4 mm in 10.0 min, beside +4.8 mm from the start on, which may be a constant offset",
        ),
        (230.0, "by +0.3 mm in 3.8 min, beside +4.8 mm from the start on, which may be a constant offset"),
    ],
)
def test_no_time_constant_longer_than_the_session_is_stated(session_s: float, words: str) -> None:
    drift = cause("temperature_drift", drift_m=0.0, warmup_m=-0.0031, housing_m=0.0079, tau_s=300.0, housing_s=1200.0)
    assert size_in_words(drift, Course(session_s)) == words


def test_a_drift_with_the_thermometer_and_one_with_time_are_stated_by_their_sum() -> None:
    """1.05 mm a kelvin from 0 mm, fitted as 0.4 mm a kelvin about the mean of 28 degrees and a slow warm-up of -4.2 mm that ends at -3.9 mm: only the sum has a meaning."""
    drift = cause("temperature_drift", drift_m=0.0004, reference_c=28.0, warmup_m=-0.0042, tau_s=1800.0)
    assert size_in_words(drift, Course(126.0, 25.0, 34.0)) == "from -5.4 mm at the start to -1.5 mm after 2.1 min"
    alone = cause("temperature_drift", warmup_m=-0.0042, tau_s=1800.0)
    assert size_in_words(alone, Course(126.0)) == "by +0.3 mm in 2.1 min, beside -4.2 mm from the start on, which may be a constant offset"
    assert "a kelvin of the thermometer and" in size_in_words(drift, Course(126.0)), "no view has a temperature: there is no sum"


def content(
    *verdict: str, where: tuple[str, ...] = (), advice: tuple[str, ...] = (), missing: tuple[str, ...] = (), moving: tuple[bool, ...] = ()
) -> dict[str, Any]:
    world = {"missing": [{"part": name} for name in missing], "foreign": [{"moves": moves} for moves in moving]}
    left = {"where": list(where), "depends_on": []}
    return {"verdict": list(verdict), "notes": [], "causes": [], "unexplained": left, "advice": list(advice), "world": world}


def test_a_healthy_session_asks_for_nothing() -> None:
    assert todo(content("none")) == []


def test_what_to_do_follows_the_verdict_the_world_and_the_advice() -> None:
    lines = todo(content("unknown", "wiggling", where=("panel",), advice=("go closer",), missing=("pipe",)))
    assert ["--sensor" in lines[0], "scene.yaml" in lines[1], lines[2], "Look at panel" in lines[3]] == [
        True,
        True,
        "Capture: go closer.",
        True,
    ]
    assert "--sensor" not in " ".join(todo(content("unknown")))


def test_the_remedy_of_a_note_comes_first() -> None:
    noted = content("unknown", where=("panel",)) | {"notes": [{"what": "Depth is registered.", "todo": "Record another image."}]}
    assert [line.split()[0] for line in todo(noted)] == ["Record", "Look"]


@pytest.mark.parametrize(("moving", "words"), [((False,), ["Correct the cell"]), ((True,), ["Look at the views"]), ((False, True), ["Correct the cell", "Look at the views"])])  # fmt: skip
def test_an_object_that_moves_is_no_fault_of_the_cell(moving: tuple[bool, ...], words: list[str]) -> None:
    lines = todo(content("none", moving=moving))
    assert [line[: len(w)] for line, w in zip(lines, words, strict=True)] == words


def test_the_gap_away_from_edges_stands_beside_one_that_few_pixels_at_edges_make() -> None:
    gap = {"shrink": 0.99, "off_edges_mm": {"before": 4.94, "after": 3.65}}
    found = {"verdict": ["flying_pixels"], "gap": gap, "causes": [], "unexplained": {"depends_on": [], "where": [], "structured": False}}
    assert sentence(found) == (
        "Camera and simulation differ by flying pixels. Away from edges the gap is 4.9 mm, and 3.6 mm once the named effects are simulated."
    )
    same = gap | {"off_edges_mm": {"before": 2.06, "after": 2.06}}
    assert sentence(found | {"gap": same}).endswith(" Away from edges a gap of 2.1 mm stays, in which no structure shows.")
    assert (
        sentence(found | {"gap": gap | {"off_edges_mm": None}})
        == "Camera and simulation differ by flying pixels, which explains 99 % of the gap."
    )


def test_what_is_expected_of_a_camera_is_stated_and_what_is_found_is_not() -> None:
    size, why = "3 % of the pixels, those of weak light", "a camera drops light by design whose depth is noisier than 8 mm"
    weak = Finding(Dropout(threshold=50.0), 0.9, size=size, expected=True, by_design=why)
    steps = Finding(Quantization(step_m=0.004), 1.0, expected=True)
    assert expected_words([weak, Finding(Interference(burst_m=0.002), 0.95), steps]) == [
        f"not in the verdict: dropout ({size}), as {why}",
        "not in the verdict: quantization, as the camera is known for it (--sensor)",
    ]


def test_effects_that_are_not_testable_for_one_reason_share_a_line() -> None:
    reasons = {"ambient": "no law", "motion": "no view was taken in motion", "time_sync": "no view was taken in motion"}
    assert untested_words(reasons) == ["not testable: ambient (no law)", "not testable: motion, time_sync (no view was taken in motion)"]
    assert untested_words({"ambient": "no law"}, " here") == ["not testable here: ambient (no law)"]


def test_a_stated_calibration_is_said_and_its_absence_too() -> None:
    stated = Calibration(HandEyeLimits(2.0, 0.2), LensLimits(0.3, 0.1), AlbedoLimits(0.4))
    assert (
        calibration_words(stated) == "calibration, as stated: hand-eye to 2 mm and 0.2 degrees, lens to 0.3 px and 0.1 %, albedos to 40 %"
    )
    assert calibration_words(Calibration(lens=LensLimits(focal_pct=0.1))) == "calibration, as stated: lens to 0 px and 0.1 %"
    assert calibration_words(Calibration()).startswith("calibration: none is stated, so hand-eye and lens count as exact")
    light = Modulation(80.32, 60.24)
    assert calibration_words(Calibration(lens=LensLimits(focal_pct=0.1), modulation=light)).endswith(
        "lens to 0 px and 0.1 %; modulation 80.32, 60.24 MHz, as stated"
    )
    only = calibration_words(Calibration(modulation=light))
    assert only.startswith("calibration: none is stated")
    assert only.endswith("modulation 80.32, 60.24 MHz, as stated")


def test_hand_eye_of_the_solution_is_stated_by_length_and_angle() -> None:
    off = exp([0.003, 0.0, 0.004, 0.0, np.radians(0.2), 0.0])
    assert hand_eye_words(off) == "hand-eye as estimated with the poses: 5.0 mm and 0.20 degrees from the stated one"


def test_hand_eye_that_is_not_estimated_is_said_to_be_held() -> None:
    held = "hand-eye is held at the stated one"
    assert hand_eye_words(np.eye(4)).startswith(held)
    assert hand_eye_words(exp([1e-5, 0.0, 0.0, 8e-5, 0.0, 0.0])).startswith(held)  # as far as the prior of an exact mount lets it go
    assert not hand_eye_words(exp([6e-5, 0.0, 0.0, 0.0, 0.0, 0.0])).startswith(held)


def test_small_effects_have_their_sizes_where_these_are_known() -> None:
    assert small_words(("hand_eye", "multipath", "motion"), {"multipath": 0.43, "motion": 0.04}) == "hand_eye, multipath (0.4 mm)"
    assert small_words(("row", "region"), {"row": 0.3, "region": 0.9}) == (
        "an error that varies with row (0.3 mm), an error that varies with the region of the cell that light comes from (0.9 mm)"
    )


def test_a_doubt_says_how_much_is_unexplained_and_how_much_may_be() -> None:
    assert doubt_words(0.056, 0.05) == "no effect is asserted: 5.6 % of the gap is unexplained, and from 5 % on effects are only suspected"


def test_most_pixels_are_those_that_the_named_effects_of_few_pixels_leave() -> None:
    assert most_pixels(["wiggling", "flying_pixels"]) == "away from edges"
    assert most_pixels(["phase_wrap"]) == "without wrapped pixels"
    assert most_pixels(["flying_pixels", "phase_wrap|dropout"]) == "away from edges and without wrapped pixels"
