# SPDX-License-Identifier: Apache-2.0
"""Single detectors of noise and loss: the sizes that they state, and the numbers that decide."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tests.tof_gap.quiet_views import CAMERA, SHAPE, VIEWS, views
from tof_core.config import updated
from tof_core.reasons import Reason
from tof_gap.limits.evidence import LevelLimits
from tof_gap.limits.missing import MissingLimits
from tof_gap.limits.noise import NoiseLimits
from tof_gap.seen.evidence.level import depth_step, noise_level
from tof_gap.seen.foreign.stripes import beat
from tof_gap.seen.missing.lost import _lost_below, brightest, least_light, losses_of, lost, outliers_removed
from tof_gap.seen.missing.mixed import flying_pixels, mixing
from tof_gap.seen.missing.wrapped import _common_size, phase_wrap
from tof_gap.seen.noise.effects import noise_effects
from tof_gap.seen.noise.lines import line_map, line_noise
from tof_gap.seen.noise.pixels import noisy_pixels, pixel_pattern

if TYPE_CHECKING:
    from tof_gap.seen.evidence.view import ViewEvidence

LIMITS, MISSING = NoiseLimits(), MissingLimits()


def rng() -> np.random.Generator:
    return np.random.default_rng(7)


@pytest.mark.parametrize("axis", [0, 1])
def test_line_noise_has_its_size_along_its_axis_alone(axis: int) -> None:
    shape = (VIEWS, SHAPE[0], 1) if axis == 1 else (VIEWS, 1, SHAPE[1])
    session = views(rng(), np.broadcast_to(rng().normal(0, 0.003, shape), (VIEWS, *SHAPE)))
    found, other = line_noise(session, axis, LIMITS.lines), line_noise(session, 1 - axis, LIMITS.lines)
    assert found.size_m == pytest.approx(0.003, rel=0.15)
    assert found.sigma > LIMITS.lines.sigma
    assert other.sigma < LIMITS.lines.sigma


def test_lines_that_too_few_views_see_are_not_judged() -> None:
    session = views(rng(), np.broadcast_to(rng().normal(0, 0.003, (VIEWS, SHAPE[0], 1)), (VIEWS, *SHAPE)))
    assert line_noise(session[:4], 1, LIMITS.lines).sigma == 0.0
    assert line_noise(session, 1, replace(LIMITS.lines, pixels=SHAPE[1] + 1)).sigma == 0.0


def test_a_few_lines_say_nothing_about_the_others() -> None:
    """A strong pattern makes edges of most lines: 20 rows are compared, 8 are not, whatever they show."""
    session = views(rng(), np.broadcast_to(rng().normal(0, 0.003, (VIEWS, SHAPE[0], 1)), (VIEWS, *SHAPE)))
    shown = []
    for rows in (20, 8):
        smooth = np.zeros(SHAPE, bool)
        smooth[30 : 30 + rows] = True
        shown.append(line_noise([replace(v, smooth=v.smooth & smooth) for v in session], 1, LIMITS.lines).sigma)
    assert shown[0] > LIMITS.lines.sigma
    assert shown[1] == 0.0


def test_a_line_map_holds_the_mean_of_each_line() -> None:
    (view, *_) = views(rng(), np.zeros((VIEWS, *SHAPE)), photons=False)
    jump = np.zeros(SHAPE)
    jump[40] = 0.01
    rows = line_map(replace(view, residual=jump / view.frame.length), 1, LIMITS.lines)
    # The high-pass takes a fifteenth of a line off it.
    assert (rows * view.frame.length)[40].mean() == pytest.approx(0.01 * 14 / 15, rel=0.01)
    assert np.abs(rows[:30]).max() < 1e-9


def test_noisy_pixels_have_their_share_and_size() -> None:
    noisy = rng().uniform(size=SHAPE) < 0.03
    found = noisy_pixels(views(rng(), noisy * rng().choice([-0.02, 0.02], (VIEWS, *SHAPE))), LIMITS.pixels)
    assert found.where[noisy].mean() > 0.7
    assert found.where[~noisy].mean() < 0.03, "neighbours of a noisy pixel differ from it too"
    assert found.size_m == pytest.approx(0.02, rel=0.35)
    assert found.chance < 1e-6
    assert noisy_pixels(views(rng()), LIMITS.pixels).share < 0.001


def test_a_single_noisy_pixel_of_a_few_hundred_may_be_chance() -> None:
    noisy, few = np.zeros(SHAPE), np.zeros(SHAPE, bool)
    noisy[40, 60], few[30:50, 50:70] = 0.05, True
    quiet = views(rng(), noisy * rng().choice([-1.0, 1.0], (VIEWS, *SHAPE)))
    some = [replace(v, smooth=v.smooth & few) for v in quiet]
    found = noisy_pixels(some, LIMITS.pixels)
    assert found.where[40, 60]
    assert found.share > LIMITS.pixel_share - 0.002
    assert found.chance > LIMITS.pixels.chance


def test_the_pattern_of_single_pixels_has_its_rms() -> None:
    pattern = rng().normal(0, 0.003, SHAPE)
    assert pixel_pattern(views(rng(), np.stack([pattern] * VIEWS))) == pytest.approx(0.003, rel=0.1)
    assert pixel_pattern(views(rng())) < 0.0005


def wave(hit: np.ndarray, *, phase: bool = True) -> np.ndarray:
    """Seven periods over the height in some views, each with a phase of its own."""
    row = np.linspace(0, 1, SHAPE[0])[None, :, None]
    offset = rng().uniform(0, 6, (VIEWS, 1, 1)) if phase else 1.0
    return np.asarray(hit[:, None, None] * 0.004 * np.sin(2 * np.pi * 7 * row + offset) * np.ones((VIEWS, *SHAPE)))


def test_a_beat_has_its_period_its_views_and_its_size() -> None:
    hit = np.arange(VIEWS) % 3 == 0
    found = beat(views(rng(), wave(hit)), LIMITS.beat)
    assert found is not None
    assert (found.turns, found.tilt) == (7.0, 0.0)
    np.testing.assert_array_equal(found.hit, hit)
    assert found.size_m == pytest.approx(0.004 / np.sqrt(2), rel=0.15)


@pytest.mark.parametrize(
    ("hit", "own_phase"),
    [(np.ones(VIEWS, bool), True), (np.arange(VIEWS) < 2, True), (np.arange(VIEWS) % 2 == 0, False), (np.zeros(VIEWS, bool), True)],
    ids=["all views", "two views", "one phase", "none"],
)
def test_no_beat_where_all_views_too_few_or_one_phase_have_it(hit: np.ndarray, *, own_phase: bool) -> None:
    assert beat(views(rng(), wave(hit, phase=own_phase)), LIMITS.beat) is None


def test_a_higher_limit_finds_no_burst_and_no_burst_of_no_view() -> None:
    hit = np.isin(np.arange(VIEWS), (1, 4, 9))[:, None, None]
    session = views(rng(), hit * rng().normal(0, 0.004, (VIEWS, *SHAPE)))
    assert [f.name for f in noise_effects(session, LIMITS)] == ["noise"]
    assert noise_effects(session, updated(LIMITS, {"burst": 3.0, "extra_share": 1.0})) == []


def test_the_noise_level_follows_amplitude() -> None:
    amplitude = np.tile(np.geomspace(100, 10_000, SHAPE[1]), (SHAPE[0], 1))
    true = 0.002 * np.sqrt(1000.0 / amplitude)
    level = noise_level(rng().normal(size=SHAPE) * true, np.ones(SHAPE, bool), amplitude, LevelLimits())
    np.testing.assert_allclose(np.median(level, axis=0)[5:-5] / true[0, 5:-5], 1.0, atol=0.25)


def test_the_noise_level_of_too_few_samples_is_the_usual_one() -> None:
    few = np.zeros(SHAPE, bool)
    few[:5, :5] = True
    assert np.unique(noise_level(np.zeros(SHAPE), few, np.ones(SHAPE), LevelLimits())) == pytest.approx([0.002])


def test_a_step_needs_several_codes() -> None:
    two = np.where(rng().uniform(size=(40, 40)) < 0.5, 0.5, 0.51)
    assert depth_step(two, LevelLimits()) == 0.0
    assert depth_step(two, LevelLimits(code_gaps=1)) == pytest.approx(0.01)


@pytest.mark.parametrize("cut_off", [1e3, 0.97])
def test_saturated_pixels_are_not_lost(cut_off: float) -> None:
    (view, *_) = views(rng())
    assert view.view.amplitude is not None
    top = brightest([view], MISSING) / MISSING.bright
    gone, light = np.zeros(SHAPE, bool), view.view.amplitude.copy()
    gone[10:20], light[10:15], light[15:20] = True, np.float32(cut_off * top), np.float32(0.8 * top)
    light[12, 40:50] = 0.0  # Where both taps are full, nothing is left of the amplitude.
    reason = np.where(gone, Reason.NO_RETURN, Reason.VALID).astype(np.uint8)
    seen = replace(view.view, depth=np.where(gone, np.nan, view.view.depth).astype(np.float32), amplitude=light, reason=reason)
    share = lost(replace(view, view=seen), MISSING, brightest([view], MISSING))
    assert share[15:20].min() == 1.0
    assert share[:15].max() == 0.0


def test_the_threshold_is_the_amplitude_at_which_half_is_lost() -> None:
    light = np.geomspace(10, 1000, 20_000)
    gone = (light < 50.0).astype(float)
    assert _lost_below(light, gone, 0.5, MISSING) == pytest.approx(50.0, rel=0.2)
    assert _lost_below(light, np.zeros(20_000), 0.5, MISSING) == 0.0


@pytest.mark.parametrize(("jump_m", "start_m"), [(-1.5, 0.0), (1.5, -1.0)])
def test_a_wrapped_phase_has_its_frequency_and_the_range_where_it_begins(jump_m: float, start_m: float) -> None:
    wrapped = np.zeros((VIEWS, *SHAPE))
    wrapped[:, 20:60, 30:80] = jump_m
    found = phase_wrap(views(rng(), wrapped), MISSING)
    assert found is not None
    assert found.effect.modulation_mhz == pytest.approx(99.9, rel=0.01)  # type: ignore[attr-defined]
    assert np.sign(found.effect.start_m) == (1.0 if start_m == 0.0 else -1.0)  # type: ignore[attr-defined]
    assert found.share is not None
    assert np.nanmedian(found.share[0][30:50, 40:70] * CAMERA.ray_length()[30:50, 40:70]) == pytest.approx(jump_m, rel=0.01)
    assert np.nanmax(np.abs(found.share[0][:15])) == 0.0


def test_a_pixel_may_be_off_by_several_whole_turns() -> None:
    turns = np.zeros((VIEWS, *SHAPE))
    turns[:, 20:60, 30:60] = 1.5
    turns[:, 20:60, 60:80] = 3.0
    found = phase_wrap(views(rng(), turns), MISSING)
    assert found is not None
    assert found.share is not None
    along_ray = found.share[0] * CAMERA.ray_length()
    assert np.nanmedian(along_ray[30:50, 35:55]) == pytest.approx(1.5, rel=0.01)
    assert np.nanmedian(along_ray[30:50, 65:75]) == pytest.approx(3.0, rel=0.01)


def test_jumps_of_many_sizes_are_no_wrapped_phase() -> None:
    many = np.zeros((VIEWS, *SHAPE))
    many[:, 20:60, 30:80] = rng().uniform(-3.0, -0.3, (VIEWS, 40, 50))
    assert phase_wrap(views(rng(), many), MISSING) is None


def test_the_common_size_is_the_median_of_the_densest_stretch() -> None:
    assert _common_size(np.array([0.5, 1.0, 1.02, 1.04, 3.0]), 0.06) == pytest.approx(1.02)


def test_holes_around_outliers_are_a_filter_s_and_single_pixels_are_not() -> None:
    valid = np.ones(SHAPE, bool)
    for row, column in ((10, 10), (30, 50), (60, 80)):
        valid[row - 1 : row + 2, column - 1 : column + 2] = False
    valid[40:60, 20:40] = False
    found = outliers_removed(valid, MISSING)
    assert found.sum() == 27, "three outliers with their neighbours"
    assert not found[40:60, 20:40].any(), "a surface without a return is larger"
    assert not outliers_removed(rng().uniform(size=SHAPE) > 0.03, MISSING).any(), "lost at random"


def at_an_edge(place: float, filtered: float = 0.0) -> list[ViewEvidence]:
    """Views with an edge four pixels wide, measured at `place` between its surfaces; of a share of its rows nothing is measured."""
    out = []
    for v in views(rng()):
        edge = np.zeros(SHAPE, bool)
        edge[:, 50:54] = True
        second = np.where(edge, v.frame.depth + 0.2, np.nan).astype(np.float32)
        mixed = np.where(edge, 0.3, 0.0).astype(np.float32)
        depth = np.where(edge, v.frame.depth + 0.2 * place, v.view.depth).astype(np.float32)
        depth[: round(filtered * SHAPE[0]), 50:54] = np.nan
        frame = replace(v.frame, rendering=replace(v.rendering, second=second, mixed=mixed))
        out.append(replace(v, frame=frame, view=replace(v.view, depth=depth), residual=(depth - v.frame.depth).astype(np.float32)))
    return out


@pytest.mark.parametrize(("filtered", "named"), [(0.3, True), (0.7, False)])
def test_what_an_edge_filter_misses_is_no_flying_pixel(filtered: float, *, named: bool) -> None:
    """The filter takes the first rows of an edge of mixed pixels."""
    assert (flying_pixels(at_an_edge(0.5, filtered), MISSING) is not None) is named


@pytest.mark.parametrize(("dark_rows", "named"), [(0.0, False), (0.7, True)])
def test_edges_that_are_too_dark_to_return_say_nothing_of_a_filter(dark_rows: float, *, named: bool) -> None:
    """Seven tenths of an edge of mixed pixels return nothing: by a filter, or since nothing there returns, edge or not."""
    rows = round(dark_rows * SHAPE[0])
    out = []
    for v in at_an_edge(0.5, 0.7):
        albedo = v.rendering.albedo.copy()
        albedo[:rows] *= 0.05
        depth = v.view.depth.copy()
        depth[:rows] = np.nan
        reason = np.where(np.isfinite(depth), Reason.VALID, Reason.NO_RETURN).astype(np.uint8)
        frame = replace(v.frame, rendering=replace(v.rendering, albedo=albedo))
        out.append(replace(v, frame=frame, view=replace(v.view, depth=depth, reason=reason, count=np.isfinite(depth).astype(np.uint16))))
    dim = least_light(out, MISSING, losses_of(out, MISSING, [np.zeros(SHAPE, bool)] * len(out)))
    assert (dim > 0.0) is named
    assert (flying_pixels(out, MISSING, dim) is not None) is named


@pytest.mark.parametrize(("place", "mixes"), [(0.0, False), (1.0, False), (0.5, True)])
def test_pixels_between_their_surfaces_are_mixed(place: float, *, mixes: bool) -> None:
    found = mixing(at_an_edge(place), MISSING)
    assert (found is not None) is mixes
    if found is not None:
        assert found[0] == pytest.approx(1.0)
        assert found[1] == VIEWS * SHAPE[0] * 4


def test_a_mixed_pixel_beside_a_dark_surface_lies_on_the_bright_one_and_says_nothing_of_a_filter() -> None:
    """Half of the rows see a second surface of so little light that the mixture of phasors stays on the first one."""
    out, dark = [], np.arange(SHAPE[0])[:, None] >= SHAPE[0] // 2
    for v, bright in zip(at_an_edge(0.0), at_an_edge(0.5), strict=True):
        second_light = np.broadcast_to(np.where(dark, 0.02, 1.0), (SHAPE[0], 3))
        # The pixels right of the edge show the second surface, with its light.
        depth, light = v.rendering.depth.copy(), v.frame.amplitude.copy()
        depth[:, 54:57] = v.rendering.second[:, 53:54]
        light[:, 54:57] = light[:, 53:54] * second_light
        mixed = np.where(np.arange(SHAPE[1]) == 50, 0.0, v.rendering.mixed).astype(np.float32)  # Too far from the second surface.
        frame = replace(v.frame, rendering=replace(v.rendering, depth=depth, mixed=mixed), depth=depth.astype(float), amplitude=light)
        measured = np.where(dark, v.view.depth, bright.view.depth)
        out.append(replace(v, frame=frame, view=replace(v.view, depth=measured)))
    found = mixing(out, MISSING)
    assert found is not None
    assert found[0] == pytest.approx(1.0, abs=0.05), "all pixels that light mixes are measured between their surfaces"
