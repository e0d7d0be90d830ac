# SPDX-License-Identifier: Apache-2.0
"""Loss as evidence: of whole views, and of some captures of a dwell."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tests.tof_gap.quiet_views import SHAPE, VIEWS, views
from tof_core.reasons import Reason
from tof_gap.limits.missing import MissingLimits
from tof_gap.seen.missing.effects import missing_effects
from tof_gap.seen.missing.lost import expected
from tof_gap.seen.session import amplitude_unit
from tof_sensor.effects.dropout import Dropout
from tof_sensor.effects.phase_wrap import PhaseWrap
from tof_sensor.effects.photon_law import PhotonLaw
from tof_sensor.frame import amplitude_gain, ideal_frame, lambert_amplitude
from tof_sensor.stated import StatedNoise

if TYPE_CHECKING:
    from tof_gap.seen.evidence.view import ViewEvidence

CAPTURES = 3
RNG = np.random.default_rng(6)


def dwelled(share: float) -> list[ViewEvidence]:
    """Views of three captures, of each of which `share` of the pixels is lost at random."""
    out = []
    for v in views(np.random.default_rng(5)):
        count = RNG.binomial(CAPTURES, 1 - share, SHAPE).astype(np.uint16)
        gone = count == 0
        depth, reason = np.where(gone, np.nan, v.view.depth), np.where(gone, Reason.NO_RETURN, Reason.VALID)
        seen = replace(v.view, captures=CAPTURES, count=count, depth=depth.astype(np.float32), reason=reason.astype(np.uint8))
        out.append(replace(v, view=seen, residual=np.where(gone, np.nan, v.residual), smooth=v.smooth & ~gone))
    return out


def test_what_every_third_capture_loses_is_lost_though_the_dwell_has_it() -> None:
    (found,) = missing_effects(dwelled(0.1), MissingLimits())
    assert found.name == "dropout"
    assert found.effect.random == pytest.approx(0.1, abs=0.01)  # type: ignore[attr-defined]


def test_a_dwell_that_lost_nothing_says_nothing() -> None:
    assert missing_effects(dwelled(0.0), MissingLimits()) == []


@pytest.mark.parametrize(("share", "names"), [(0.15, ["dropout"]), (0.02, [])])
def test_what_one_dark_part_loses_is_lost_though_it_is_little_of_all(share: float, names: list[str]) -> None:
    """A part of 30 x 8 pixels in every view loses a share of them; of all pixels that is less than one in a hundred."""
    out = []
    for whole, half in zip(dwelled(0.0), dwelled(share), strict=True):
        part = np.zeros(SHAPE, np.int16)
        part[40:70, 50:58] = 1
        count = np.where(part == 1, half.view.count, whole.view.count)
        rendering = replace(whole.rendering, part=part)
        out.append(replace(whole, frame=replace(whole.frame, rendering=rendering), view=replace(whole.view, count=count)))
    counted = np.mean([1.0 - v.view.count.mean() / CAPTURES for v in out])
    assert counted < MissingLimits().lost_share
    assert [f.name for f in missing_effects(out, MissingLimits())] == names


def dark_lost(*, amplitude: bool = True, share: float = 0.25) -> tuple[list[ViewEvidence], float]:
    """Views without the darkest `share` of their pixels, and the amplitude below which they are lost, in the unit of the amplitude image."""
    made = dwelled(0.0)
    unit = float(np.median([amplitude_gain(v.frame.amplitude, lambert_amplitude(v.rendering)) or 0.0 for v in made])) if amplitude else 1.0
    threshold = unit * float(np.quantile([lambert_amplitude(v.rendering) for v in made], share))
    out = []
    for v in made:
        gone = unit * lambert_amplitude(v.rendering) < threshold
        view = replace(v.view, count=np.where(gone, 0, v.view.count), amplitude=v.view.amplitude if amplitude else None)
        out.append(replace(v, view=view, smooth=v.smooth & ~gone))
    return out, threshold


def test_the_amplitude_below_which_pixels_are_lost_is_in_the_unit_of_the_amplitude_image() -> None:
    lost, threshold = dark_lost()
    (found,) = missing_effects(lost, MissingLimits())
    assert isinstance(found.effect, Dropout)
    assert threshold > 100, "of the image, not of the simulation"
    assert found.effect.threshold == pytest.approx(threshold, rel=0.06)
    assert found.note == "half are lost at 0.73 of the median amplitude"
    assert found.size == "25 % of the pixels, those of weak light: below 73 % of the median light", "a lost pixel has no amplitude here"
    assert not found.rare, "all that there is in the dark is lost"
    assert found.remedy.startswith("nothing if these surfaces are not needed: cameras drop weak pixels by design")


def test_a_loss_of_the_brightest_pixels_has_no_threshold_in_weak_light() -> None:
    made, share = dwelled(0.0), 0.06
    limit = np.quantile([lambert_amplitude(v.rendering) for v in made], 1.0 - share)
    lost = [replace(v.view, count=np.where(lambert_amplitude(v.rendering) > limit, 0, v.view.count)) for v in made]
    (found,) = missing_effects([replace(v, view=view) for v, view in zip(made, lost, strict=True)], MissingLimits())
    assert isinstance(found.effect, Dropout)
    assert found.effect.threshold == 0.0
    assert found.effect.random == pytest.approx(share, abs=0.01)
    assert "those of strong light" in found.size


@pytest.mark.parametrize(("share", "times", "by_design"), [(0.03, 6.0, True), (0.03, 2.5, False), (0.08, 6.0, False)])
def test_few_pixels_of_much_light_fill_up_by_design(share: float, times: float, *, by_design: bool) -> None:
    """A strip of the image returns `times` the median light, and is lost."""
    strip = np.zeros(SHAPE, bool)
    strip[:, 10 : 10 + round(share * SHAPE[1])] = True
    lost = []
    for v in dwelled(0.0):
        light = lambert_amplitude(v.rendering)
        bright = np.where(strip & (light > 0), times * np.median(light) / np.maximum(light, 1e-9), 1.0)
        rendering = replace(v.rendering, albedo=v.rendering.albedo * bright)
        view = replace(v.view, count=np.where(strip, 0, v.view.count))
        lost.append(replace(v, frame=replace(v.frame, rendering=rendering), view=view, smooth=v.smooth & ~strip))
    (found,) = missing_effects(lost, MissingLimits())
    assert "those of strong light" in found.size
    assert found.expected is by_design
    assert found.by_design == ("pixels fill up where surfaces are near and bright" if by_design else "")


def test_the_fitted_loss_simulated_loses_as_many_pixels_as_the_session_lost() -> None:
    lost, _ = dark_lost()
    (found,) = missing_effects(lost, MissingLimits())
    unit, rng = amplitude_unit(lost), np.random.default_rng(0)
    assert unit is not None
    gone = [found.effect.apply(ideal_frame(v.rendering, gain=unit), rng).missing.mean() for v in lost]
    assert np.mean(gone) == pytest.approx(0.25, abs=0.02)


def test_without_an_amplitude_image_the_threshold_says_what_it_is_of() -> None:
    lost, threshold = dark_lost(amplitude=False)
    (found,) = missing_effects(lost, MissingLimits())
    assert isinstance(found.effect, Dropout)
    assert found.effect.threshold == pytest.approx(threshold, rel=0.06)
    assert "no amplitude image: amplitude is albedo cos(incidence) / r²" in found.note


@pytest.mark.parametrize(("shot_mm", "light", "expected"), [(4.7, 1.0, False), (5.5, 1.0, True), (5.5, 0.5, False)])
def test_loss_of_light_too_weak_to_measure_is_by_design_where_it_is_weaker_than_usual(
    shot_mm: float, light: float, *, expected: bool
) -> None:
    """At the threshold, 0.73 of the median amplitude, noise is 1.17 times as large as there: 5.5 and 6.4 mm."""
    lost, _ = dark_lost()
    median = float(np.median(np.concatenate([v.frame.amplitude[v.smooth] for v in dwelled(0.0)])))
    law = PhotonLaw(floor_m=0.0, shot_m=1e-3 * shot_mm, ambient_m=0.0, far_m=0.0, reference=median)
    (found,) = missing_effects(lost, MissingLimits(by_design_light=light), law=lambda: law)
    assert found.expected is expected


@pytest.mark.parametrize(("share", "expected"), [(0.05, False), (1.0, True)])
def test_few_pixels_too_weak_to_measure_are_lost_by_design_whatever_is_usual(share: float, *, expected: bool) -> None:
    """More than 5 % are lost; noise at the threshold is 8.8 mm."""
    lost, _ = dark_lost()
    median = float(np.median(np.concatenate([v.frame.amplitude[v.smooth] for v in dwelled(0.0)])))
    law = PhotonLaw(floor_m=0.0, shot_m=7.5e-3, ambient_m=0.0, far_m=0.0, reference=median)
    (found,) = missing_effects(lost, MissingLimits(by_design_light=0.5, by_design_share=share), law=lambda: law)
    assert found.expected is expected


def test_a_camera_that_averages_drops_weak_light_by_the_noise_before_its_average() -> None:
    """2.9 mm at the threshold after an average over nine pixels: 8.8 mm before it."""
    lost, _ = dark_lost()
    averaged = [replace(v, correlation=replace(v.correlation, area=9.0)) for v in lost]
    median = float(np.median(np.concatenate([v.frame.amplitude[v.smooth] for v in dwelled(0.0)])))
    law = PhotonLaw(floor_m=0.0, shot_m=2.5e-3, ambient_m=0.0, far_m=0.0, reference=median)
    limits = MissingLimits(by_design_light=1.0)
    expected = [missing_effects(views, limits, law=lambda: law)[0].expected for views in (lost, averaged)]
    assert expected == [False, True]


def test_a_threshold_at_which_depth_is_good_is_told_from_one_that_any_camera_needs() -> None:
    lost, _ = dark_lost()
    median = float(np.median(np.concatenate([v.frame.amplitude[v.smooth] for v in dwelled(0.0)])))
    law = PhotonLaw(floor_m=0.0, shot_m=2.5e-3, ambient_m=0.0, far_m=0.0, reference=median)
    (found,) = missing_effects(lost, MissingLimits(), law=lambda: law)
    assert found.remedy.startswith("lower the camera's threshold of amplitude or confidence")
    assert "only 3 mm of noise there" in found.remedy


def test_a_threshold_that_the_data_sheet_states_is_expected_until_it_is_half_as_much_again() -> None:
    lost, threshold = dark_lost()
    for stated, known in ((0.8 * threshold, True), (0.5 * threshold, False)):
        (found,) = missing_effects(lost, MissingLimits(), stated=StatedNoise(effects=(Dropout(stated, 50.0),)))
        assert found.expected is known


def test_loss_at_random_is_expected_of_a_camera_that_is_known_for_it() -> None:
    known = StatedNoise(effects=(Dropout(random=0.1),))
    (found,) = missing_effects(dwelled(0.1), MissingLimits(), stated=known)
    assert found.expected
    (more,) = missing_effects(dwelled(0.2), MissingLimits(), stated=known)
    assert not more.expected


def test_a_loss_of_one_in_forty_in_the_dark_has_a_threshold_that_loses_as_many() -> None:
    lost, threshold = dark_lost(share=0.025)
    (found,) = missing_effects(lost, MissingLimits())
    assert isinstance(found.effect, Dropout)
    assert found.effect.threshold == pytest.approx(threshold, rel=0.06)
    assert not found.rare, "of as many of the darkest pixels as are lost, all are"


def test_a_loss_of_less_than_half_of_the_darkest_pixels_may_be_that_of_outliers() -> None:
    """A filter in the camera removes outliers, and there are more of them in weak light."""
    lost, _ = dark_lost(share=0.05)
    kept = [replace(v.view, count=np.where(RNG.random(SHAPE) < 0.6, CAPTURES, v.view.count).astype(np.uint16)) for v in lost]
    (found,) = missing_effects([replace(v, view=view) for v, view in zip(lost, kept, strict=True)], MissingLimits())
    assert found.rare


@pytest.mark.parametrize(("turn_m", "names"), [(0.25, []), (0.6, ["phase_wrap"])])
def test_a_jump_shorter_than_any_turn_is_no_lost_turn(turn_m: float, names: list[str]) -> None:
    jump = np.zeros((VIEWS, *SHAPE))
    jump[:, 20:40, 30:60] = -turn_m
    assert [f.name for f in missing_effects(views(np.random.default_rng(5), jump), MissingLimits())] == names


def test_jumps_of_which_means_show_a_third_or_half_are_whole_jumps_of_one_capture() -> None:
    """Of three captures one jumps by 2.1 m, or of two where one is lost: no capture is off by 0.7 or 1.05 m."""
    jump = np.array([0.0, 0.7, 1.05])[np.random.default_rng(7).choice(3, p=[0.97, 0.02, 0.01], size=(VIEWS, *SHAPE))]
    seen = [replace(v, view=replace(v.view, captures=3, count=np.full(SHAPE, 3))) for v in views(np.random.default_rng(5), jump)]
    (found,) = missing_effects(seen, MissingLimits())
    assert isinstance(found.effect, PhaseWrap)
    assert found.effect.turn_m == pytest.approx(2.1, abs=5e-3)
    assert found.effect.others_m == ()
    assert found.share is not None
    lengths = np.stack([v.frame.length for v in seen])
    for size in (0.7, 1.05):
        assert np.nanmedian((found.share * lengths)[jump == size]) == pytest.approx(size, abs=5e-3)


def test_jumps_of_single_captures_are_no_parts_of_larger_ones() -> None:
    """Views of three captures show a jump and its threefold as views of one do, so that the smaller one is whole."""
    jump = np.array([0.0, 1.25, 3.75])[np.random.default_rng(7).choice(3, p=[0.9, 0.09, 0.01], size=(VIEWS, *SHAPE))]
    seen = views(np.random.default_rng(5), jump, captures=[1, 3] * (VIEWS // 2))
    (found,) = missing_effects(seen, MissingLimits())
    assert isinstance(found.effect, PhaseWrap)
    assert found.effect.turn_m == pytest.approx(1.25, abs=5e-3)


@pytest.mark.parametrize(("captures", "stated"), [(1, (0.39,)), (3, ())])
def test_half_of_a_jump_is_that_of_a_mean_of_captures(captures: int, stated: tuple[float, ...]) -> None:
    """Of two captures one jumps by 0.78 m: the mean is off by 0.39 m, which no capture is. It is subtracted all the same."""
    jump = np.array([0.0, 0.78, 0.39])[np.random.default_rng(7).choice(3, p=[0.9, 0.07, 0.03], size=(VIEWS, *SHAPE))]
    seen = [replace(v, view=replace(v.view, captures=captures)) for v in views(np.random.default_rng(5), jump)]
    found = missing_effects(seen, MissingLimits())[-1]
    assert isinstance(found.effect, PhaseWrap)
    assert found.effect.turn_m == pytest.approx(0.78, abs=1e-3)
    assert found.effect.others_m == pytest.approx(stated, abs=1e-3)
    assert found.share is not None
    half = np.abs(jump - 0.39) < 1e-9
    lengths = np.stack([v.frame.length for v in seen])
    assert np.nanmedian((found.share * lengths)[half]) == pytest.approx(0.39, abs=2e-3)


def test_a_jump_by_which_two_captures_differ_is_half_of_one() -> None:
    """Of two captures one jumps by 3.3 or 4.9 m, seldom both: where only one does, the standard error of the mean is a half of its jump."""
    whole = np.array([0.0, 3.3, 4.9])
    rng = np.random.default_rng(7)
    jump = whole[rng.choice(3, p=[0.9, 0.03, 0.07], size=(VIEWS, *SHAPE))]
    both = rng.random((VIEWS, *SHAPE)) < 0.2
    seen = views(np.random.default_rng(5), np.where(both, jump, jump / 2))
    of_two = [
        replace(v, view=replace(v.view, captures=2, count=np.full(SHAPE, 2), sigma=np.where(b, 2e-3, 0.2 * j)))
        for v, j, b in zip(seen, jump, both, strict=True)
    ]
    (found,) = missing_effects(of_two, MissingLimits())
    assert isinstance(found.effect, PhaseWrap)
    assert found.effect.turn_m == pytest.approx(4.9, abs=5e-3)
    assert found.effect.others_m == pytest.approx((3.3,), abs=5e-3)
    assert found.effect.others_share == pytest.approx((0.3,), abs=0.02)


def test_a_wrong_choice_among_three_frequencies_lands_at_several_jumps() -> None:
    """16, 80 and 120 MHz: 0.625, 0.75 and 0.9375 m; 1.5 m is two whole turns of none, and too rare to be stated."""
    rng = np.random.default_rng(7)
    sizes = np.array([0.0, 0.625, 0.75, 0.9375, 1.5])
    jump = sizes[rng.choice(5, p=[0.9, 0.05, 0.03, 0.0195, 0.0005], size=(VIEWS, *SHAPE))]
    seen = views(np.random.default_rng(5), jump)
    (found,) = missing_effects(seen, MissingLimits())
    assert isinstance(found.effect, PhaseWrap)
    assert found.effect.turn_m == pytest.approx(0.625, abs=1e-3)
    assert found.effect.others_m == pytest.approx((0.75, 0.9375), abs=1e-3)
    assert found.effect.others_share == pytest.approx((0.3, 0.195), abs=0.02)
    assert found.effect.start_m < 0, "too far"
    assert found.share is not None
    measured = np.isfinite(found.share) & (jump < 1.0)
    lengths = np.stack([v.frame.length for v in seen])
    np.testing.assert_allclose((found.share * lengths)[measured], jump[measured], atol=2e-3)


@pytest.mark.parametrize(("albedo", "names"), [(0.5, ["dropout"]), (0.01, [])])
def test_what_a_part_loses_in_the_weakest_light_of_the_session_every_camera_loses(albedo: float, names: list[str]) -> None:
    """A part of 10 x 8 pixels in every view, one in a hundred of all, loses a third of them."""
    out = []
    for whole, half in zip(dwelled(0.0), dwelled(0.3), strict=True):
        part = np.zeros(SHAPE, np.int16)
        part[40:50, 50:58] = 1
        count = np.where(part == 1, half.view.count, whole.view.count)
        rendering = replace(whole.rendering, part=part, albedo=np.where(part == 1, np.float32(albedo), whole.rendering.albedo))
        amplitude = np.where(part == 1, np.float32(albedo / 0.5), np.float32(1.0)) * whole.view.amplitude
        view = replace(whole.view, count=count, amplitude=amplitude)
        out.append(replace(whole, frame=replace(whole.frame, rendering=rendering), view=view))
    assert [f.name for f in missing_effects(out, MissingLimits())] == names


@pytest.mark.parametrize(("brightest_lost", "names"), [(True, []), (False, ["dropout"])])
def test_a_part_that_loses_its_brightest_pixels_is_saturated(*, brightest_lost: bool, names: list[str]) -> None:
    """A fifth of a bright part's pixels is lost: those of most light, more than any other pixel returned, or any."""
    out, part = [], np.zeros(SHAPE, np.int16)
    part[40:48, 30:80] = 1
    albedo = np.where(part == 1, np.linspace(0.5, 5.0, SHAPE[1])[None], 0.5).astype(np.float32)
    renderings = [replace(v.rendering, part=part, albedo=albedo) for v in dwelled(0.0)]
    most_light = np.quantile([lambert_amplitude(r)[part == 1] for r in renderings], 0.8)
    for v, rendering in zip(dwelled(0.0), renderings, strict=True):
        lost = (part == 1) & ((lambert_amplitude(rendering) > most_light) if brightest_lost else RNG.random(SHAPE) < 0.2)
        amplitude = np.where(lost, 0.0, 1000 * lambert_amplitude(rendering))
        view = replace(
            v.view,
            count=np.where(lost, 0, CAPTURES).astype(np.uint16),
            reason=np.where(lost, Reason.NO_RETURN, Reason.VALID).astype(np.uint8),
            depth=np.where(lost, np.nan, v.view.depth).astype(np.float32),
            amplitude=amplitude.astype(np.float32),
        )
        frame = replace(v.frame, rendering=rendering, amplitude=amplitude)
        out.append(replace(v, view=view, frame=frame, smooth=v.smooth & ~lost))
    assert [f.name for f in missing_effects(out, MissingLimits())] == names


def test_the_lamp_s_shadow_beside_an_edge_and_grazing_surfaces_are_no_loss() -> None:
    view = views(np.random.default_rng(5))[0]
    limits = MissingLimits(edge_reach_px=4)
    edge = np.zeros(SHAPE, bool)
    edge[:, 50] = True
    with_edge = replace(view, edge=edge)
    counted = expected(with_edge, limits)
    assert not counted[:, 46:55].any()
    assert counted[20:60, 56:].any()
    steep = replace(view.rendering, incidence=np.full(SHAPE, np.radians(61.0), np.float32))
    assert not expected(replace(view, frame=replace(view.frame, rendering=steep)), limits).any()


def test_loss_that_all_parts_carry_is_predicted_by_light() -> None:
    """A tenth of the pixels is a part that is lost whole, and of the other part one pixel in twenty-five is."""
    rng, lossy = np.random.default_rng(6), []
    for v in dwelled(0.0):
        part = np.zeros(SHAPE, np.int16)
        part[:, : SHAPE[1] // 10] = 1
        gone = (part == 1) | (rng.random(SHAPE) < 0.04)
        seen = replace(
            v.view,
            depth=np.where(gone, np.float32(np.nan), v.view.depth),
            reason=np.where(gone, Reason.NO_RETURN, v.view.reason).astype(np.uint8),
        )
        lossy.append(
            replace(v, view=seen, smooth=v.smooth & ~gone, frame=replace(v.frame, rendering=replace(v.frame.rendering, part=part)))
        )
    (found,) = missing_effects(lossy, MissingLimits())
    assert isinstance(found.effect, Dropout)
    assert sorted(found.parts) == [0, 1]
    assert found.share is not None
    assert np.nanmean(found.share[:, :, : SHAPE[1] // 10 - 3]) > 0.5
