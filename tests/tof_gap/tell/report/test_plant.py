# SPDX-License-Identifier: Apache-2.0
"""The verdict in a plant's words: mechanism, place, size, remedy, cost."""

from __future__ import annotations

from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import pytest

from tests.tof_gap.quiet_views import SHAPE, VIEWS, views
from tof_core.calibration import Calibration, HandEyeLimits
from tof_gap.seen.finding import Finding
from tof_gap.seen.missing.loss import GoesWith, Loss
from tof_gap.tell.report.plant import Words, _in_motion, _remedy, acts, cost, plant_words, where
from tof_sensor.effects.ambient import Ambient
from tof_sensor.effects.dropout import Dropout
from tof_sensor.effects.hand_eye import HandEye
from tof_sensor.effects.wiggling import Wiggling

if TYPE_CHECKING:
    from tof_gap.tell.diagnosis import Diagnosis
    from tof_scene.scene import Scene

SCENE = cast("Scene", SimpleNamespace(parts=[SimpleNamespace(name=n) for n in ("panel", "pipe")]))
MAP = np.broadcast_to(np.linspace(0.0, 0.010, SHAPE[0] * SHAPE[1]).reshape(SHAPE), (VIEWS, *SHAPE))


WAVE = Wiggling(sine_m=0.003, cosine_m=0.004, modulation_mhz=100.0)


def diagnosis(
    *,
    waves: tuple[Wiggling, ...] = (WAVE,),
    ties: tuple[str, ...] = (),
    doubted: bool = False,
    few: bool = False,
    size: str = "",
    remedy: str = "",
    parts: tuple[int, ...] = (),
) -> Diagnosis:
    evidence = views(np.random.default_rng(1))
    cause = SimpleNamespace(
        named=SimpleNamespace(name="wiggling", effects=waves, ties=ties, std=({},) * len(waves), suspected=few), size_m=0.004
    )
    finding = Finding(Dropout(threshold=120.0, random=0.02), 0.9, size=size, remedy=remedy, parts=parts)
    made = {"evidence": evidence, "residual": [v.residual for v in evidence], "shares": {"wiggling": MAP}}
    return cast(
        "Diagnosis",
        SimpleNamespace(causes=(cause,), findings=(finding,), doubted=doubted, suspected=lambda c: doubted or c.named.suspected, **made),
    )


def test_each_effect_is_said_with_its_size_place_remedy_and_cost() -> None:
    wiggling, dropout = plant_words(diagnosis(), SCENE)
    assert wiggling.size == "±5.0 mm every 0.37 m of range"
    assert wiggling.where == "on panel"
    assert wiggling.cost == "this effect puts one pixel in twenty off by 9.5 mm or more"
    assert dropout.size == "2 % of the pixels at random, most pixels below amplitude 120"
    assert (dropout.where, dropout.remedy) == ("", Dropout.REMEDY)
    assert dropout.cost == "these pixels have no depth, and the others are not affected"
    assert wiggling.sentence() == (
        "Wiggling: the range error swings with distance, because of the shape of the emitted wave or pulse (±5.0 mm every 0.37 m of range; on panel). "
        f"To do: {Wiggling.REMEDY}. If nothing is done, this effect puts one pixel in twenty off by 9.5 mm or more."
    )


def test_several_waves_are_stated_by_what_they_make_together() -> None:
    """Two waves of nearly one period, which take each other off."""
    other = Wiggling(sine_m=-0.003, cosine_m=-0.003, modulation_mhz=98.0)
    (wiggling, _) = plant_words(diagnosis(waves=(WAVE, other)), SCENE)
    assert (
        wiggling.size
        == "4.0 mm RMS over the 90 % of the pixels that change by 1 mm and more, 3.8 mm over all, 9.8 mm between the extremes, "
        "in waves of 0.37 and 0.38 m of range"
    )
    more = [Wiggling(sine_m=1e-4, modulation_mhz=mhz) for mhz in (80.0, 60.0, 40.0)]
    (wiggling, _) = plant_words(diagnosis(waves=(WAVE, other, *more)), SCENE)
    assert wiggling.size.endswith("in 5 waves of 0.37 to 0.94 m of range")


@pytest.mark.parametrize(
    ("x_m", "stated_mm", "usual"),
    [(0.0012, 0.0, True), (0.0012, 2.0, False), (0.004, 0.0, False)],
    ids=["usual", "beyond the stated", "far off"],
)
def test_hand_eye_as_good_as_calibrations_are_is_to_be_stated_first(x_m: float, stated_mm: float, *, usual: bool) -> None:
    stated = Calibration(hand_eye=HandEyeLimits(translation_mm=stated_mm))
    made = cast("Diagnosis", SimpleNamespace(config=SimpleNamespace(calibration=stated)))
    words = _remedy(HandEye(x_m=x_m), made)
    assert words.startswith("many calibrations are no better") == usual
    assert words.endswith(HandEye.REMEDY)


def test_lost_pixels_are_stated_by_what_they_go_with() -> None:
    loss = Loss(GoesWith.LIGHT, 0.034, (1, 0), amplitude=75.5, of_median=0.15)
    _, dropout = plant_words(diagnosis(size=loss.size, remedy=loss.remedy, parts=loss.parts), SCENE)
    assert dropout.sentence() == (
        "Dropout: pixels without depth, away from edges and surfaces seen at a slant (3 % of the pixels, those of weak light: below amplitude 75.5, 15 % of the median; on pipe and panel). "
        "To do: nothing if these surfaces are not needed: cameras drop weak pixels by design (confidence or amplitude threshold). Otherwise "
        "expose longer or come closer; a lower threshold returns these pixels with more noise. "
        "If nothing is done, these pixels have no depth, and the others are not affected."
    )


def test_an_effect_of_few_pixels_costs_by_how_many_they_are() -> None:
    few = np.zeros((VIEWS, *SHAPE))
    few[:, :2, :] = 0.005
    share = 100.0 * 2 / SHAPE[0]
    assert cost(diagnosis(), list(few)) == f"this effect puts {share:.0f} % of the pixels off by 1 mm or more, half of them by 5 mm or more"
    assert (
        acts(0.005, list(few))
        == f"5.0 mm RMS over the {share:.0f} % of the pixels that change by 0.5 mm and more, {5 * np.sqrt(share / 100):.1f} mm over all"
    )


def test_an_effect_of_hardly_any_pixel_has_no_share_of_naught() -> None:
    single = np.zeros((VIEWS, *SHAPE))
    single[0, 0, 0] = 0.02
    assert (
        cost(diagnosis(), list(single)) == "this effect puts under 0.1 % of the pixels off by 1 mm or more, half of them by 20 mm or more"
    )


def test_an_effect_of_all_pixels_is_an_rms_alone() -> None:
    assert acts(0.0042, list(np.full((VIEWS, *SHAPE), 0.0042))) == "4.2 mm RMS"


def test_offsets_of_every_pixel_act_on_all_of_them_though_some_are_near_nought() -> None:
    white = np.random.default_rng(4).normal(0.0, 0.003, (VIEWS, *SHAPE))
    white[:, :10, :] = np.nan
    assert acts(0.003, list(white)) == "3.0 mm RMS"
    white[:, : SHAPE[0] // 2, :] = 0.0
    # The least offsets, a tenth of these, count as none in the 3.0 mm.
    assert acts(0.003, list(white)) == "3.0 mm RMS over the 39 % of the pixels that change by 0.84 mm and more, 1.9 mm over all"


def test_of_many_effects_that_the_session_cannot_separate_none_has_a_remedy() -> None:
    wiggling, _ = plant_words(diagnosis(ties=("depth_scale", "range_offset", "hand_eye")), SCENE)
    assert wiggling.sentence() == (
        "One of 4 effects that this session cannot separate: wiggling (±5.0 mm every 0.37 m of range; on panel), depth scale, range offset or "
        "hand eye. To do: calibrate nothing for it yet; the report's advice says what separates them."
    )


def test_rivals_that_the_session_cannot_separate_stand_beside_the_name() -> None:
    words, _ = plant_words(diagnosis(ties=("range_offset", "hand_eye")), SCENE)
    assert "Or range offset or hand eye, which this session cannot separate from it. To do: " in words.sentence()


def test_noise_that_light_and_read_out_make_alike_is_said_to_be_one_of_both() -> None:
    noisy = Finding(Ambient(uniform_m=1e-3, reference=2000.0), 0.9, note="noise 1.8 times the law's")
    words = plant_words(
        cast("Diagnosis", SimpleNamespace(evidence=views(np.random.default_rng(1)), causes=(), findings=(noisy,), shares={})), SCENE
    )[0]
    assert words.sentence() == (
        f"Ambient: {Ambient.MEANING} (noise 1.8 times the law's). Or noise, which this session cannot separate from it. To do: record once more with sunlight and lamps shaded: "
        "noise that disappears was theirs, noise that stays is the camera's read-out noise; longer dwells reduce both."
    )


def test_a_suspected_effect_asks_for_nothing_before_it_is_confirmed() -> None:
    words, dropout = plant_words(diagnosis(doubted=True), SCENE)
    assert words.sentence().startswith("Perhaps wiggling: ")
    assert words.sentence().endswith(f"Too much stays unexplained to be sure of it. If it is confirmed: {Wiggling.REMEDY}.")
    assert not dropout.suspected, "what noise or loss shows needs no fit"


def test_an_effect_that_too_few_views_show_says_so() -> None:
    words, _ = plant_words(diagnosis(few=True), SCENE)
    assert words.suspected
    assert words.sentence().endswith(f"{VIEWS} views before a board are too few to be sure of it. If it is confirmed: {Wiggling.REMEDY}.")


def test_what_is_not_known_is_not_said() -> None:
    assert Words("noise", "more noise", "", "", "", "").sentence() == "Noise: more noise."


def test_pixels_without_a_measurement_have_no_cost() -> None:
    lost = cast("Diagnosis", SimpleNamespace(residual=[np.full(SHAPE, np.nan)]))
    assert cost(lost, [MAP[0]]) == ""


@pytest.mark.parametrize(("shared", "place"), [(0.0, "on panel"), (1.0, "on panel and pipe")])
def test_the_parts_that_carry_most_of_it_are_named(shared: float, place: str) -> None:
    d = diagnosis()
    for v in d.evidence:
        v.rendering.part[:, : SHAPE[1] // 2] = 1
    size = np.ones((VIEWS, *SHAPE)) * 0.005
    size[:, :, : SHAPE[1] // 2] *= shared
    assert where(d, list(size), SCENE) == place


@pytest.mark.parametrize(
    ("name", "moving", "words"),
    [
        ("motion", 8, "in the 8 of 20 views that were taken in motion; "),
        ("time_sync", 8, "in the 8 of 20 views that were taken in motion; "),
        ("motion", 20, ""),
        ("wiggling", 8, ""),
    ],
)
def test_an_error_of_a_moving_hand_is_in_the_views_taken_in_motion(name: str, moving: int, words: str) -> None:
    views = [SimpleNamespace(frame=SimpleNamespace(context=SimpleNamespace(moving=k < moving))) for k in range(20)]
    assert _in_motion(name, cast("Any", SimpleNamespace(evidence=views))) == words
