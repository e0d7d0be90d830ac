# SPDX-License-Identifier: Apache-2.0
"""Scatter: the photon law is found again, steps are seen, smooth bias is no scatter."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from tests.tof_gap.quiet_views import CAMERA, SHAPE, SIGMA_M, VIEWS, rendering, views
from tof_gap.limits.evidence import EvidenceLimits, LevelLimits
from tof_gap.limits.noise import NoiseLimits
from tof_gap.seen.detected import judged
from tof_gap.seen.evidence.level import depth_step, noise_level
from tof_gap.seen.evidence.residual import gather
from tof_gap.seen.foreign.stripes import Beat, beat, explained
from tof_gap.seen.noise.bursts import _stand_out
from tof_gap.seen.noise.effects import lines_found, noise_effects, without_offsets
from tof_gap.seen.noise.exposure import exposed
from tof_gap.seen.noise.lines import everywhere_m, line_noise, shared_m
from tof_gap.seen.noise.own_law import own_law
from tof_gap.seen.noise.photons import binned, fit_law, over_law, quiet_law, view_ratio
from tof_gap.seen.noise.stereo import like_stereo
from tof_gap.solve.hypotheses.candidates import not_testable
from tof_sensor.effects.ambient import Ambient
from tof_sensor.effects.noise import Noise
from tof_sensor.effects.photon_law import PhotonLaw
from tof_sensor.session import NoiseBins


def rng() -> np.random.Generator:
    """The same numbers in every test, whatever ran before."""
    return np.random.default_rng(2)


LIMITS = NoiseLimits()


def test_scatter_does_not_see_what_is_smooth() -> None:
    v, u = np.mgrid[:150, :200] / 50.0
    residual = 0.02 * np.sin(v) * np.cos(u) + rng().normal(0, 0.002, v.shape)
    sigma = noise_level(residual, np.ones(v.shape, bool), np.full(v.shape, 1000.0) * np.exp(0.1 * v), LevelLimits())
    assert np.median(sigma) == pytest.approx(0.002, rel=0.03)


def test_law_of_shot_and_ambient_is_found_without_a_floor() -> None:
    amplitude = np.geomspace(100, 10000, 40)
    ratio = np.median(amplitude) / amplitude
    variance = 0.001**2 * ratio + 0.0005**2 * ratio**2
    law = fit_law(NoiseBins(np.zeros(40), amplitude, np.ones(40), np.ones(40), variance, np.full(40, 2000.0)), 0.0, LIMITS).law
    assert np.hypot(law.shot_m, law.far_m) == pytest.approx(0.001, rel=0.02)  # All at 1 m: near and far light are one.
    assert law.ambient_m == pytest.approx(0.0005, rel=0.02)
    assert law.floor_m < 1e-4


def test_a_bin_that_hardly_ever_changes_does_not_make_the_law() -> None:
    amplitude = np.geomspace(100, 10000, 40)
    variance = 0.001**2 * np.median(amplitude) / amplitude
    variance[-1] = 5e-15  # Too bright to scatter beyond the depth code's step.
    b = NoiseBins(np.zeros(40), amplitude, np.ones(40), np.ones(40), variance, np.full(40, 2000.0))
    np.testing.assert_allclose(fit_law(b, 0.0, LIMITS).ratio(b)[:-1], 1.0, atol=0.15)


def test_ambient_light_of_far_surfaces_is_no_burst() -> None:
    amplitude, range2 = np.tile(np.geomspace(100, 10000, 20), 4), np.repeat([0.25, 0.5, 1.0, 2.0], 20)
    variance = (0.0005**2 + 0.0012**2 * range2) * np.median(amplitude) / amplitude
    b = NoiseBins(np.repeat(np.arange(4.0), 20), amplitude, range2, range2, variance, np.full(80, 2000.0))
    fitted = fit_law(b, 0.0, LIMITS)
    np.testing.assert_allclose(fitted.ratio(b), 1.0, atol=0.02)
    assert fitted.law.far_m == pytest.approx(0.0012, rel=0.02)


def test_constant_scatter_shows_as_a_floor() -> None:
    amplitude = np.geomspace(100, 10000, 40)
    variance = 0.003**2 + 0.001**2 * np.median(amplitude) / amplitude
    assert fit_law(
        NoiseBins(np.zeros(40), amplitude, np.ones(40), np.ones(40), variance, np.full(40, 2000.0)), 0.001, LIMITS
    ).law.floor_m == pytest.approx(0.003, rel=0.05)


@pytest.mark.parametrize("step", [0.001, 0.005, 0.0125])
def test_step_of_the_code_is_seen(step: float) -> None:
    depth = np.round(rng().uniform(0.5, 0.9, (100, 100)) / step) * step
    assert depth_step(depth, LevelLimits()) == pytest.approx(step, rel=1e-3)


@pytest.mark.parametrize(("noise", "step"), [(0.0, 0.008), (0.0012, 0.008), (0.016, 0.002)])
def test_a_mean_of_captures_has_the_step_of_one_unless_noise_takes_all_codes_alike(noise: float, step: float) -> None:
    """Codes of 8 mm, four captures: noise of 1.2 mm leaves most pixels on whole codes, noise of 16 mm none."""
    numbers = rng()
    plane = numbers.uniform(0.5, 0.9, (100, 100))
    captures = [np.round((plane + numbers.normal(0, noise, plane.shape)) / 0.008) * 0.008 for _ in range(4)]
    assert depth_step(np.mean(captures, axis=0), LevelLimits(), captures=4) == pytest.approx(step, rel=1e-3)


def test_continuous_depth_has_no_step() -> None:
    assert depth_step(rng().uniform(0.5, 1.0, (100, 100)), LevelLimits()) == 0.0


def said(extra: np.ndarray | None) -> list[tuple[str, str]]:
    """Names and notes of what is found in a session with `extra` (V, H, W) metres of scatter."""
    return [(f.name, f.note) for f in noise_effects(views(np.random.default_rng(3), extra), LIMITS)]


def test_photons_alone_are_no_finding() -> None:
    assert said(None) == []


@pytest.mark.parametrize("offset_m", [0.003, 0.02])
def test_offsets_of_single_pixels_are_no_noise_however_large(offset_m: float) -> None:
    assert said(np.broadcast_to(rng().normal(0, offset_m, SHAPE), (VIEWS, *SHAPE))) == []


def test_scatter_at_every_amplitude_is_noise() -> None:
    ((name, note),) = said(rng().normal(0, 0.004, (VIEWS, *SHAPE)))
    assert name == "noise"
    assert "at every amplitude" in note


def test_named_noise_and_the_law_beside_it_are_the_scatter_that_was_measured() -> None:
    session = views(np.random.default_rng(3), rng().normal(0, 0.004, (VIEWS, *SHAPE)))
    (found,) = noise_effects(session, LIMITS)
    law = own_law(session, [found.effect], LIMITS)
    assert isinstance(found.effect, Noise)
    assert law is not None
    both = law.variance(np.array([2000.0]), np.array([1.0])) + found.effect.extra_m**2
    assert np.sqrt(both) == pytest.approx(np.hypot(SIGMA_M, 0.004), rel=0.04)
    assert found.effect.duty == 1.0


def test_what_is_known_to_be_wrong_in_the_variance_of_a_view_is_no_noise_of_the_law() -> None:
    """Half of the views carry 3 mm more between neighbours than light makes, the other half nothing."""
    wrong = 0.003 * (np.arange(VIEWS) % 2).astype(np.float64)
    session = views(np.random.default_rng(3), wrong[:, None, None] * np.random.default_rng(5).normal(0, 1, (VIEWS, *SHAPE)))
    as_seen, put_right = own_law(session, [], LIMITS), own_law(session, [], LIMITS, np.square(wrong))
    assert as_seen is not None
    assert put_right is not None
    amplitude, range2 = np.array([2000.0]), np.array([1.0])
    assert np.sqrt(as_seen.variance(amplitude, range2)) > 1.08 * SIGMA_M
    assert np.sqrt(put_right.variance(amplitude, range2)) == pytest.approx(SIGMA_M, rel=0.02)


def test_noise_in_bursts_has_its_share_of_frames_and_the_law_is_of_the_others() -> None:
    hit = np.isin(np.arange(VIEWS), (1, 4, 9))[:, None, None]
    session = views(np.random.default_rng(3), hit * np.random.default_rng(8).normal(0, 0.006, (VIEWS, *SHAPE)))
    (found,) = noise_effects(session, LIMITS)
    law = own_law(session, [found.effect], LIMITS)
    assert isinstance(found.effect, Noise)
    assert law is not None
    assert (found.effect.duty, found.effect.extra_m) == pytest.approx((3 / VIEWS, 0.006), rel=0.04)
    assert np.sqrt(law.variance(np.array([2000.0]), np.array([1.0]))) == pytest.approx(SIGMA_M, rel=0.05)


def test_noise_that_grows_towards_the_end_of_a_pulse_s_gates_is_no_burst() -> None:
    """Two of twelve views look far, where the noise is half as large again as light and range squared say; three are hit by a burst."""
    middle = np.array([0.8, 0.9, 1.0, 1.1, 1.2, 1.3, 1.5, 1.7, 1.9, 2.1, 2.8, 2.9])
    view, range_m = np.repeat(np.arange(12), 12), (middle[:, None] * np.linspace(0.6, 1.4, 12)).ravel()
    amplitude = 2000.0 / range_m**2 * np.tile([0.5, 1.0, 2.0], 48)
    gated = 1 + 1.25 * np.clip((range_m - 2.0) / 1.0, 0, None) ** 2
    burst = np.isin(np.arange(12), (1, 5, 9))
    for extra in (0.0, 1.0):
        variance = 0.001**2 * 2000.0 / amplitude * gated * (1 + extra * burst[view])
        b = NoiseBins(view.astype(float), amplitude, range_m**2, range_m**2, variance, np.full(144, 2000.0))
        ratio = view_ratio(b, quiet_law(b, 0.0, 12, LIMITS), 12, LIMITS)
        assert _stand_out(np.log(ratio), LIMITS, LIMITS.burst).tolist() == (burst & (extra > 0)).tolist()


@pytest.mark.parametrize("captures", [(9,) * VIEWS, (1, 9) * (VIEWS // 2)], ids=["dwells", "dwells and captures between them"])
def test_the_law_is_that_of_one_capture_whatever_a_view_is_the_mean_of(captures: tuple[int, ...]) -> None:
    session = views(np.random.default_rng(3), captures=captures)
    law = own_law(session, [], LIMITS)
    assert law is not None
    assert np.sqrt(law.variance(np.array([2000.0]), np.array([1.0]))) == pytest.approx(SIGMA_M, rel=0.05)
    assert noise_effects(session, LIMITS) == []


def test_noise_of_a_dwells_mean_is_stated_as_that_of_one_capture() -> None:
    session = views(np.random.default_rng(3), rng().normal(0, 0.004, (VIEWS, *SHAPE)), captures=(9,) * VIEWS)
    (found,) = noise_effects(session, LIMITS)
    assert isinstance(found.effect, Noise)
    assert found.effect.extra_m == pytest.approx(0.004, rel=0.1)
    assert found.share is not None
    assert np.nanmedian(found.share) == pytest.approx(found.effect.extra_m / 3)


@pytest.mark.parametrize(
    ("quiet_spread", "hit"), [(0.02, [False] * 9 + [True] * 3), (0.3, [False] * 12)], ids=["alike", "each its own scene"]
)
def test_a_burst_stands_out_from_what_quiet_views_differ_by(quiet_spread: float, hit: list[bool]) -> None:
    ln_variance = np.concatenate([quiet_spread * np.linspace(-1, 1, 9), [0.4, 0.42, 0.45]])
    assert _stand_out(ln_variance, LIMITS, LIMITS.burst).tolist() == hit


def test_noise_within_the_stated_photon_law_is_no_effect() -> None:
    session = views(np.random.default_rng(3), rng().normal(0, 0.003, (VIEWS, *SHAPE)))
    assert [f.name for f in noise_effects(session, LIMITS)] == ["noise"]
    b = binned(session, LIMITS.bins, LIMITS)
    stated = PhotonLaw(floor_m=float(np.sqrt(np.median(b.variance))) / 1.1, shot_m=0.0, reference=2000.0)
    assert noise_effects(session, LIMITS, law=stated) == []
    quieter = replace(stated, floor_m=stated.floor_m / 1.5)
    assert [f.name for f in noise_effects(session, LIMITS, law=quieter)] == ["noise"]


@pytest.mark.parametrize("lost", [None, np.full(SHAPE, np.nan, np.float32)])
def test_a_view_without_amplitude_among_others_is_no_other_camera(lost: np.ndarray | None) -> None:
    session = list(views(np.random.default_rng(3)))
    seen = [v.view for v in session]
    seen[4] = replace(seen[4], amplitude=lost)
    again = gather(seen, [v.rendering for v in session], None, EvidenceLimits(edge_px=0))  # type: ignore[arg-type]
    assert noise_effects(again, LIMITS) == []
    assert not like_stereo(again, LIMITS)
    assert np.median(again[4].frame.amplitude / again[3].frame.amplitude) == pytest.approx(1.0, abs=0.2)


def test_rows_that_jump_are_noise() -> None:
    ((name, note),) = said(np.repeat(rng().normal(0, 0.003, (VIEWS, SHAPE[0], 1)), SHAPE[1], axis=2))
    assert name == "noise"
    size, _, what = note.partition(" ")
    assert float(size) == pytest.approx(3.0, abs=0.3)
    assert what == "mm by rows"


def test_rims_of_objects_are_no_noise_of_rows() -> None:
    """In every view, every other row of one quarter of the image is off; noise of rows is in all quarters."""
    rng = np.random.default_rng(4)
    jumps = 0.004 * rng.standard_normal((VIEWS, SHAPE[0], 1))
    place, width = rng.integers(0, 4, VIEWS), SHAPE[1] // 4
    rims = np.zeros((VIEWS, *SHAPE))
    for rim, jump, at in zip(rims, jumps, place, strict=True):
        rim[:, at * width : (at + 1) * width] = jump
    seen = [views(rng, of) for of in (np.broadcast_to(jumps, rims.shape), rims)]
    whole, local = (line_noise(v, 1, LIMITS.lines) for v in seen)
    whole_m, local_m = (shared_m(v, 1, LIMITS.lines) for v in seen)
    assert whole.size_m == pytest.approx(0.004, rel=0.15)
    assert whole_m == pytest.approx(0.004, rel=0.15)
    assert local.size_m > 0.0005
    assert local_m < 0.5 * local.size_m
    assert everywhere_m(seen[0], 1, LIMITS.lines) == pytest.approx(0.004, rel=0.15)
    assert everywhere_m(seen[1], 1, LIMITS.lines) == 0.0


def test_rows_whose_noise_changes_its_sign_with_range_are_noise_of_rows() -> None:
    """Each quarter of a row has a noise of its own, of the same size: the quarters share none, and the row's mean has half."""
    rng = np.random.default_rng(4)
    quarters = np.repeat(0.008 * rng.standard_normal((VIEWS, SHAPE[0], 4)), SHAPE[1] // 4, axis=2)
    seen = views(rng, np.pad(quarters, ((0, 0), (0, 0), (0, SHAPE[1] - quarters.shape[2])), mode="edge"))
    assert shared_m(seen, 1, LIMITS.lines) < 0.0015
    assert 0.003 < everywhere_m(seen, 1, LIMITS.lines) < 0.008
    assert [of.axis for of in lines_found(seen, LIMITS)] == [1]


def test_a_constant_row_is_a_pattern_and_no_noise() -> None:
    assert said(np.tile(np.repeat(rng().normal(0, 0.003, (1, SHAPE[0], 1)), SHAPE[1], axis=2), (VIEWS, 1, 1))) == []


def test_stripes_of_a_beat_have_turns_and_a_slope_that_comes_and_goes_has_not() -> None:
    row = np.linspace(0, 1, SHAPE[0])[None, :, None]
    hit = (np.arange(VIEWS) % 2 == 0)[:, None, None]

    def wave(turns: float) -> np.ndarray:
        return np.asarray(hit * 0.004 * np.sin(2 * np.pi * turns * row + rng().uniform(0, 6, (VIEWS, 1, 1))) * np.ones((VIEWS, *SHAPE)))

    ((name, _),) = said(wave(7.0))
    assert name == "interference"
    assert "interference" not in [n for n, _ in said(wave(2.5))]


def test_a_fixed_pattern_larger_than_the_light_s_scatter_is_no_noise() -> None:
    assert said(np.broadcast_to(rng().normal(0, 0.01, SHAPE), (VIEWS, *SHAPE))) == []


def test_few_restless_pixels_are_noise() -> None:
    restless = rng().uniform(size=SHAPE) < 0.05
    ((name, note),) = said(restless * rng().choice([-0.013, 0.013], (VIEWS, *SHAPE)))
    assert name == "noise"
    there, share, over_all = map(float, re.search(r"([\d.]+) mm on (.+) % of the pixels, (.+) mm RMS over all$", note).groups())  # type: ignore[union-attr]
    assert over_all == pytest.approx(13.0 * np.sqrt(0.05), rel=0.2)
    assert there == pytest.approx(over_all / np.sqrt(share / 100), rel=0.1)


def test_views_that_scatter_everywhere_alike_are_noise_in_bursts() -> None:
    hit = np.isin(np.arange(VIEWS), (1, 4, 9))[:, None, None]
    assert said(hit * rng().normal(0, 0.006, (VIEWS, *SHAPE))) == [("noise", "in bursts: 3 of 12 views hit (views 2, 5, 10)")]


def test_offsets_of_pixels_make_no_burst_of_the_views_with_most_captures() -> None:
    """A mean of four captures has a quarter of the noise's variance and all of that of the offsets."""
    captures, offsets = np.where(np.arange(VIEWS) % 3, 1, 4), rng().normal(0, 0.003, SHAPE)
    root = np.sqrt(captures)[:, None, None]  # by which `views` divides the offsets, too
    seen = views(np.random.default_rng(3), offsets * root, captures=captures.tolist())
    of_one = binned(views(np.random.default_rng(3), np.broadcast_to(offsets, (VIEWS, *SHAPE))), LIMITS.bins, LIMITS)
    raw = binned(seen, LIMITS.bins, LIMITS)
    many = captures[raw.view.astype(int)] == 4
    assert np.median(raw.variance[many] / of_one.variance[many]) == pytest.approx(
        1 + 3 * 0.003**2 / np.median(of_one.variance[many]), rel=0.1
    )
    beside = without_offsets(raw, seen)
    assert np.median(beside.variance[many] / of_one.variance[many]) == pytest.approx(1.0, rel=0.05)
    np.testing.assert_array_equal(beside.variance[~many], raw.variance[~many])
    assert noise_effects(seen, LIMITS) == []


@pytest.mark.parametrize("shared", [0.0, 0.5, 1.0])
def test_captures_that_share_noise_make_no_burst(shared: float) -> None:
    """A filter over captures leaves the mean of n captures n^s / n of the variance of one."""
    captures = np.where(np.arange(VIEWS) % 3, 1, 4)
    quiet = views(np.random.default_rng(3), captures=captures.tolist())
    noise = np.stack([(v.view.depth - v.frame.depth) * v.frame.length for v in quiet]) * np.sqrt(captures)[:, None, None]
    seen = views(np.random.default_rng(3), noise * captures[:, None, None] ** (shared / 2), photons=False, captures=captures.tolist())
    assert noise_effects(seen, LIMITS) == []
    law = own_law(seen, [], LIMITS)
    assert law is not None
    assert np.sqrt(law.variance(np.array([2000.0]), np.array([1.0]))) == pytest.approx(SIGMA_M, rel=0.05)


def exposed_automatically(bright: np.ndarray, spread: float = 0.05) -> NoiseBins:
    """Bins of views (V,) that are so much brighter than the darkest; the exposure is shortened by as much, and the amplitude stated per exposure."""
    count, each = len(bright), 10
    amplitude = bright[:, None] * np.geomspace(1000, 10000, each)
    variance = 0.001**2 * 5000.0 / (amplitude / bright[:, None]) * np.exp(spread * rng().standard_normal((count, 1)))
    ones = np.ones(count * each)
    return NoiseBins(np.repeat(np.arange(float(count)), each), amplitude.ravel(), ones, ones, variance.ravel(), 2000.0 * ones)


def test_views_that_are_noisier_the_brighter_they_are_were_exposed_automatically() -> None:
    bright = rng().permutation(np.geomspace(1.0, 8.0, VIEWS))
    b = exposed_automatically(bright)
    assert exposed(b, fit_law(b, 0.0, LIMITS), LIMITS, bright)
    plain = replace(b, variance=0.001**2 * 5000.0 / b.amplitude)
    assert not exposed(plain, fit_law(plain, 0.0, LIMITS), LIMITS, bright), "the same law in all views"
    assert not exposed(b.of(b.view < 2), fit_law(b.of(b.view < 2), 0.0, LIMITS), LIMITS, bright), "two views show no dependence"
    usual = view_ratio(b, fit_law(b, 0.0, LIMITS), VIEWS, LIMITS)
    beside = view_ratio(b, fit_law(b, 0.0, LIMITS), VIEWS, LIMITS, bright)
    assert np.std(np.log(beside)) < 0.3 * np.std(np.log(usual))


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("bursts", [(), (0, 4, 7)])
def test_a_burst_stands_out_of_views_as_bright_where_exposure_is_automatic(seed: int, bursts: tuple[int, ...]) -> None:
    """Exposures that are shortened beyond the light of the fourth view, in order of brightness; the views of bursts by brightness."""
    bright = np.random.default_rng(seed).permutation(np.geomspace(0.4, 8.0, VIEWS))
    b, hit = exposed_automatically(np.maximum(bright, 1.0)), np.isin(np.argsort(np.argsort(bright)), bursts)
    b = replace(b, variance=b.variance * np.where(hit, 3.0, 1.0)[b.view.astype(int)])
    ratio = view_ratio(b, quiet_law(b, 0.0, VIEWS, LIMITS), VIEWS, LIMITS, bright)
    assert ratio / np.median(ratio[~hit]) == pytest.approx(np.where(hit, 3.0, 1.0), rel=0.3)


@pytest.mark.parametrize(("slope", "automatic"), [(1.0, True), (0.15, False)])
def test_noise_that_hardly_rises_with_brightness_is_of_a_fixed_exposure(slope: float, *, automatic: bool) -> None:
    bright = rng().permutation(np.geomspace(1.0, 8.0, VIEWS))
    b = exposed_automatically(bright, spread=0.01)
    b = replace(b, variance=b.variance * (bright ** (slope - 1.0))[b.view.astype(int)])
    assert exposed(b, fit_law(b, 0.0, LIMITS), LIMITS, bright) == automatic


@pytest.mark.parametrize(("short", "merged"), [(1.0, False), (0.8, False), (0.4, True)])
def test_noise_that_rises_where_a_short_exposure_begins_is_of_merged_exposures(short: float, *, merged: bool) -> None:
    """Pixels above four times the median amplitude are taken from an exposure that collects the share `short` of the photons."""
    amplitude = np.geomspace(500.0, 20_000.0, 20 * VIEWS)
    variance = 0.001**2 * 5000.0 / amplitude / np.where(amplitude > 8000.0, short, 1.0)
    variance *= rng().normal(1.0, 0.03, amplitude.shape)
    ones = np.ones_like(amplitude)
    b = NoiseBins(np.resize(np.arange(float(VIEWS)), amplitude.shape), amplitude, ones, ones, variance, 2000.0 * ones)
    assert exposed(b, fit_law(b, 0.0, LIMITS), LIMITS, np.ones(VIEWS)) == merged


def test_noise_under_automatic_exposure_is_no_effect() -> None:
    """Brighter by up to 4 at the same noise: as a burst of the bright views, or as noise at every amplitude, it would be 2 mm."""
    bright = rng().permutation(np.geomspace(1.0, 4.0, VIEWS))
    seen = [
        replace(v, frame=replace(v.frame, amplitude=k * v.frame.amplitude), view=replace(v.view, amplitude=k * v.view.amplitude))
        for k, v in zip(bright, views(rng()), strict=True)
    ]
    assert noise_effects(seen, LIMITS) == []
    assert noise_effects(seen, replace(LIMITS, exposure_chance=0.0, exposure_rise=9.0)) != [], "without allowing for exposure"
    law = PhotonLaw(shot_m=0.001, reference=2000.0)
    assert "under automatic or merged exposures" in str(Ambient.not_testable(judged(seen, LIMITS, law)))
    assert "under automatic or merged exposures" not in str(Ambient.not_testable(judged(views(rng()), LIMITS, law)))


def test_noise_is_compared_with_a_stated_law_where_that_was_measured() -> None:
    """The law understates the noise of dark pixels, which its data sheet lacks: they are no evidence of foreign light."""
    seen = views(rng())
    bins = binned(seen, LIMITS.bins, LIMITS)
    fitted = fit_law(bins, 0.0, LIMITS).law
    assert fitted.darkest == bins.amplitude.min()
    middle = float(np.median(bins.amplitude))
    compared = judged(seen, LIMITS, replace(fitted, darkest=middle)).noise
    assert compared is not None
    assert 0 < len(compared.view) < len(bins.view)
    assert compared.amplitude.min() >= middle
    brighter = replace(fitted, darkest=2.0 * float(bins.amplitude.max()))
    assert over_law(bins, brighter) == 1.0
    reason = Ambient.not_testable(judged(seen, LIMITS, brighter))
    assert reason is not None
    assert reason.startswith("the photon law in --sensor was measured at amplitudes from")


def test_bursts_beside_dwells_of_different_length_are_found() -> None:
    captures = np.where(np.arange(VIEWS) % 3, 1, 4)
    hit = np.isin(np.arange(VIEWS), (1, 3, 8))[:, None, None]
    seen = views(np.random.default_rng(3), hit * rng().normal(0, 0.008, (VIEWS, *SHAPE)), captures=captures.tolist())
    assert [f.name for f in noise_effects(seen, LIMITS)] == ["noise"]


def test_bins_of_views_with_as_many_captures_are_left_as_they_are() -> None:
    seen = views(rng(), np.broadcast_to(rng().normal(0, 0.003, SHAPE), (VIEWS, *SHAPE)), captures=[4] * VIEWS)
    b = binned(seen, LIMITS.bins, LIMITS)
    assert without_offsets(b, seen) is b


@pytest.mark.parametrize("views_hit", [3, VIEWS])
def test_reference_frequencies_that_fail_to_merge_noise_is_no_effect_of_its_own(views_hit: int) -> None:
    extra = (np.arange(VIEWS) < views_hit)[:, None, None] * rng().normal(0, 0.006, (VIEWS, *SHAPE))
    seen = views(np.random.default_rng(3), extra)
    assert [f.name for f in noise_effects(seen, LIMITS)] == ["noise"]
    assert noise_effects(seen, LIMITS, patchy=True) == []


def in_some_views(amplitude_m: float) -> np.ndarray:
    """(V, H, W) metres of stripes along the rows, eight over the height, with a new phase in each of five views."""
    row = np.arange(SHAPE[0])[None, :, None] / SHAPE[0]
    phase = rng().uniform(0, 2 * np.pi, (VIEWS, 1, 1))
    hit = np.isin(np.arange(VIEWS), (0, 2, 3, 7, 8))[:, None, None]
    return np.asarray(amplitude_m * np.sin(2 * np.pi * 8 * row + phase) * hit * np.ones((1, 1, SHAPE[1])))


def test_stripes_in_some_views_are_interference() -> None:
    wave = in_some_views(0.004)
    assert said(wave) == [("interference", "stripes of 8 turns in 5 of 12 views")]
    seen = list(views(rng(), wave))
    seen[1] = replace(seen[1], smooth=np.zeros(SHAPE, bool))
    assert [f.name for f in noise_effects(seen, LIMITS)] == ["interference"], "beside a view that sees nothing"


@pytest.mark.parametrize(("structure_m", "explain"), [(0.001, True), (0.006, False)])
def test_stripes_that_are_a_small_part_of_another_structure_are_none(structure_m: float, *, explain: bool) -> None:
    """Stripes of 2.8 mm RMS in five views, beside an error of many waves in all."""
    field = gaussian_filter(rng().standard_normal((VIEWS, *SHAPE)), (0, 3, 3))
    seen = views(rng(), in_some_views(0.004) + structure_m * field / field.std())
    hit = np.isin(np.arange(VIEWS), (0, 2, 3, 7, 8))
    assert (explained(seen, Beat(8.0, 0.0, hit, 0.0028), LIMITS.beat) > LIMITS.beat.explains) == explain
    assert (beat(seen, LIMITS.beat) is not None) == explain


@pytest.mark.parametrize(("left_m", "name"), [(0.0015, ["interference"]), (0.0035, [])])
def test_stripes_must_exceed_what_maps_of_named_effects_leave(left_m: float, name: list[str]) -> None:
    """Stripes of 2.8 mm RMS."""
    wave = in_some_views(0.004)
    assert [f.name for f in noise_effects(views(rng(), wave), LIMITS, of_maps_m=left_m)] == name


@pytest.mark.parametrize(("scatter_m", "name"), [(0.002, []), (0.005, ["interference"])])
def test_stripes_that_all_captures_of_a_dwell_share_are_of_the_scene(scatter_m: float, name: list[str]) -> None:
    wave = in_some_views(0.008)
    seen = []
    for v in views(rng(), wave):
        sigma = (scatter_m * np.sqrt(np.median(v.frame.amplitude) / v.frame.amplitude)).astype(np.float32)
        seen.append(replace(v, view=replace(v.view, captures=3, sigma=sigma, count=np.full(SHAPE, 3, np.uint16))))
    assert [f.name for f in noise_effects(seen, LIMITS)] == name


def test_a_stereo_camera_is_told_by_its_scatter() -> None:
    rng = np.random.default_rng(5)
    assert not like_stereo(views(rng), LIMITS)
    range2 = np.stack([(rendering(0.05 * k).depth * CAMERA.ray_length()) ** 2 for k in range(VIEWS)])
    session = views(rng, 0.003 * range2 * rng.standard_normal((VIEWS, *SHAPE)), photons=False)
    assert like_stereo(session, LIMITS)
    why = not_testable(session, LIMITS)
    assert why["wiggling"] == "the noise grows with the square of range and does not depend on amplitude: this is no time-of-flight camera"
    assert "cad_deviation" not in why
    assert "wiggling" not in not_testable(session, LIMITS, left_out={"wiggling"}), "nothing is asked of what is left out"


def test_surfaces_whose_depth_code_never_changes_make_no_stereo_camera() -> None:
    """Head-on in the near views, dim pixels keep their code of 1 mm: no noise shows there, though the code's step is known."""
    rng = np.random.default_rng(5)
    dim = 2000.0 * np.exp(0.8 * np.sin(np.arange(SHAPE[1]) / 9.0)) < 1400.0
    steady = dim[None, None, :] & (np.arange(VIEWS) < 4)[:, None, None]
    light = np.stack([v.frame.amplitude for v in views(rng)])
    noise = np.where(steady, 0.0, 0.0004 * np.sqrt(2000.0 / light) * rng.standard_normal(light.shape))
    seen = views(rng, noise, photons=False)
    assert like_stereo(seen, LIMITS)
    assert not like_stereo([replace(v, step_m=0.001) for v in seen], LIMITS)


def test_pixels_that_err_alike_in_every_view_are_no_noise() -> None:
    assert said(np.tile(rng().normal(0, 0.004, (1, *SHAPE)), (VIEWS, 1, 1))) == []


def test_noise_that_is_left_where_photons_hide_later_ones_is_no_effect_of_its_own() -> None:
    seen = views(np.random.default_rng(3), rng().normal(0, 0.006, (VIEWS, *SHAPE)))
    assert [f.name for f in noise_effects(seen, LIMITS)] == ["noise"]
    assert noise_effects(seen, LIMITS, piled_up=True) == []
