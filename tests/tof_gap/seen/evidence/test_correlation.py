# SPDX-License-Identifier: Apache-2.0
"""The correlation of noise that a filter in the camera leaves: what single pixels, lines and areas of it are worth."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, uniform_filter

from tests.tof_gap.quiet_views import CAMERA, rendering, views
from tof_core.capture import Capture, View
from tof_core.reasons import Reason
from tof_gap.config import GapConfig
from tof_gap.limits.evidence import CorrelationLimits, EvidenceLimits
from tof_gap.seen.evidence.correlation import INDEPENDENT, NoiseCorrelation, noise_correlation, variance_apart
from tof_gap.seen.evidence.residual import gather
from tof_gap.seen.noise.effects import beside_lines, lines_found, noise_effects
from tof_gap.seen.noise.lines import line_noise, line_noise_by_view
from tof_gap.seen.noise.own_law import own_law
from tof_gap.seen.noise.photons import binned, constant_part, fit_law

if TYPE_CHECKING:
    from collections.abc import Callable

    from tof_core.arrays import Float
    from tof_gap.seen.evidence.view import ViewEvidence

LIMITS = CorrelationLimits()
SHAPE = 120, 160


def found(firmware: Callable[[Float], Float], smooth: Float | float = 0.0, count: int = 6) -> NoiseCorrelation:
    """Of views of unit noise through a filter, beside an error (H, W)."""
    rng = np.random.default_rng(5)
    seen = [firmware(rng.normal(size=SHAPE)) + smooth for _ in range(count)]
    return noise_correlation(seen, [np.ones(SHAPE, bool)] * count, LIMITS)


def averaged(width: int) -> Callable[[Float], Float]:
    return lambda noise: np.asarray(uniform_filter(noise, width))


def test_independent_pixels_share_no_noise() -> None:
    assert found(np.asarray) is INDEPENDENT


@pytest.mark.parametrize("width", [3, 5])
def test_means_over_a_window(width: int) -> None:
    """A window of m x m leaves 1 / m^2 of the variance, and all of the noise of means over larger areas."""
    of = found(averaged(width))
    assert of.area == pytest.approx(width**2, rel=0.1)
    assert of.line == pytest.approx(width, rel=0.1)
    # Autocorrelation 1 - k / m: next neighbours show 6 - 8 (1 - 1 / m) + 2 (1 - 2 / m) = 4 / m of 6, pixels two apart a different share.
    near, next_but_one = 4 / width / 6, (6 - 8 * (1 - 2 / width) + 2 * max(0.0, 1 - 4 / width)) / 6
    assert of.variance([near, next_but_one]) == pytest.approx(1.0, rel=0.1)
    # Independent noise beside it, such as that of rounding, adds its variance to both.
    assert of.variance([near + 0.5, next_but_one + 0.5]) == pytest.approx(1.5, rel=0.1)
    assert of.window_px == width


def test_a_gaussian_window() -> None:
    """Its means over large areas have 4 pi s^2 times the variance of as many independent pixels."""
    of = found(lambda noise: gaussian_filter(noise, 1.0))
    assert of.area == pytest.approx(4 * np.pi, rel=0.1)


def test_an_error_that_is_smooth_over_the_image_is_no_correlation() -> None:
    row, column = np.mgrid[: SHAPE[0], : SHAPE[1]]
    wave = 3.0 * np.sin(2 * np.pi * (row + column) / 60)
    assert not found(np.asarray, wave).correlated
    assert found(averaged(3), wave / 9).area == pytest.approx(9.0, rel=0.25)


def test_structure_wider_than_the_windows_of_cameras_is_no_correlation() -> None:
    """The squares of a printed board are 12 pixels wide, and measure 2 standard deviations apart."""
    row, column = np.mgrid[: SHAPE[0], : SHAPE[1]] // 12
    assert not found(np.asarray, 2.0 * ((row + column) % 2)).correlated


def test_noise_over_many_pixels_is_noise_where_captures_differ_by_it() -> None:
    """A camera that interpolates between projected dots: means over 9 x 9 pixels, with a ninth of the noise among next neighbours."""
    rng = np.random.default_rng(5)
    seen = [uniform_filter(rng.normal(size=SHAPE), 9) for _ in range(6)]
    variance = float(np.mean([s.var() for s in seen]))

    def of(between2: float) -> NoiseCorrelation:
        return noise_correlation(seen, [np.ones(SHAPE, bool)] * 6, LIMITS, between2=between2)

    assert not of(0.0).correlated
    assert of(variance).area == pytest.approx(81.0, rel=0.25)
    near, next_but_one = (variance_apart(seen, step) for step in (1, 2))
    assert of(variance).variance([near, next_but_one]) == pytest.approx(variance, rel=0.05)


def test_captures_that_differ_by_more_than_pixels_do_anywhere_are_no_correlation() -> None:
    """Whole images that step, by foreign light or a swaying hand, beside noise that a few neighbours share."""
    rng = np.random.default_rng(5)
    seen = [uniform_filter(rng.normal(size=SHAPE), 9) for _ in range(6)]
    variance = float(np.mean([s.var() for s in seen]))
    assert not noise_correlation(seen, [np.ones(SHAPE, bool)] * 6, LIMITS, between2=3.0 * variance).correlated


def test_noise_of_rows_and_columns_is_no_correlation_of_neighbours() -> None:
    rng = np.random.default_rng(8)
    lines = rng.normal(size=SHAPE[1])[None] + rng.normal(size=SHAPE[0])[:, None]
    assert found(np.asarray, lines) is INDEPENDENT


def test_few_pixels_say_nothing() -> None:
    few = np.zeros(SHAPE, bool)
    few[:10, :10] = True
    noise = [uniform_filter(np.random.default_rng(1).normal(size=SHAPE), 3)]
    assert noise_correlation(noise, [few], LIMITS) is INDEPENDENT


def test_a_sample_of_the_pixels_shares_less() -> None:
    of = NoiseCorrelation(2.3, 3.0, 9.0)
    assert of.sampled(1.0) == 9.0
    assert of.sampled(0.1) == pytest.approx(1.8)
    assert INDEPENDENT.sampled(0.5) == 1.0


def test_sigma_of_a_filtered_view_is_that_of_its_pixels_and_of_its_means() -> None:
    """3 x 3 means of noise of 4 mm have 1.33 mm a pixel; blocks of 9 x 9 have the noise of 81 independent pixels of 4 mm."""
    rng = np.random.default_rng(2)
    noise = np.stack([averaged(3)(rng.normal(0, 0.004, (86, 112))) for _ in range(12)])
    seen = views(rng, noise, photons=False)
    assert np.median([np.median(v.sigma * v.frame.length) for v in seen]) == pytest.approx(0.004 / 3, rel=0.05)
    assert np.median([np.median(v.mean_sigma * v.frame.length) for v in seen]) == pytest.approx(0.004, rel=0.1)


def test_the_photon_law_of_a_filtered_camera_states_its_window() -> None:
    rng = np.random.default_rng(2)
    noise = np.stack([averaged(3)(rng.normal(0, 0.006, (86, 112))) for _ in range(12)])
    law = own_law(views(rng, noise, photons=False), [], GapConfig().noise)
    assert law is not None
    assert law.window_px == 3
    assert np.sqrt(law.variance(np.array([2000.0]), np.array([1.0]))) == pytest.approx(0.002, rel=0.1)


def test_rounding_to_millimetres_after_a_filter_is_no_noise_at_every_amplitude() -> None:
    """Photon noise is averaged over 3 x 3 pixels, then rounded: only the rounding, 0.29 mm, is the same at every amplitude."""
    made = []
    for v in views(np.random.default_rng(7)):
        depth = v.frame.depth + averaged(3)(v.view.depth - v.frame.depth)
        made.append(replace(v.view, depth=(np.rint(depth / 1e-3) * 1e-3).astype(np.float32)))
    seen = gather(made, [rendering(0.05 * k) for k in range(len(made))], None, EvidenceLimits(edge_px=0))  # type: ignore[arg-type]
    assert seen[0].correlation.correlated
    limits = GapConfig().noise
    fitted = fit_law(binned(seen, limits.bins, limits), 0.001, limits)
    assert constant_part(fitted, 0.001) < 2.5e-4


def test_pixels_without_partners_two_apart_make_no_bin_of_noise() -> None:
    """Only three columns of six are smooth: next neighbours can be compared, pixels two apart cannot."""
    rng = np.random.default_rng(2)
    noise = np.stack([averaged(3)(rng.normal(0, 0.006, (86, 112))) for _ in range(12)])
    seen, limits = views(rng, noise, photons=False), GapConfig().noise
    assert seen[0].correlation.correlated
    narrow = np.arange(112) % 6 < 3
    assert len(binned(seen, limits.bins, limits).view)
    assert not len(binned([replace(v, smooth=v.smooth & narrow) for v in seen], limits.bins, limits).view)


def test_the_noise_of_lines_is_that_of_each_view() -> None:
    """Rows of 1 mm in the first half of the views and of 4 mm in the others, averaged over 3 rows: 0.58 and 2.3 mm."""
    rng, rows = np.random.default_rng(2), np.repeat([0.001, 0.004], 6)
    noise = [averaged(3)(rng.normal(0, 0.002, (86, 112)) + rng.normal(0, size, (86, 1))) for size in rows]
    seen = views(rng, np.stack(noise), photons=False)
    found = line_noise_by_view(seen, 1, GapConfig().noise.lines)
    halves = np.median(found.reshape(2, 6), axis=1)
    np.testing.assert_allclose(halves, np.array([0.001, 0.004]) / np.sqrt(3), rtol=0.25)
    assert line_noise_by_view(seen, 0, GapConfig().noise.lines).max() < 2e-4


def test_beside_noise_of_lines_only_averages_of_whole_neighbourhoods_count() -> None:
    rng = np.random.default_rng(2)
    noise = np.stack([averaged(3)(rng.normal(0, 0.002, (86, 112)) + rng.normal(0, 0.004, (86, 1))) for _ in range(12)])
    seen, limits = list(views(rng, noise, photons=False)), GapConfig().noise
    depth, reason = seen[0].view.depth.copy(), seen[0].view.reason.copy()
    depth[40, 50], reason[40, 50] = np.nan, Reason.NO_RETURN
    seen[0] = replace(seen[0], view=replace(seen[0].view, depth=depth, reason=reason))
    lines = lines_found(seen, limits)
    assert [of.axis for of in lines] == [1]
    whole = beside_lines(seen, lines)
    lost = seen[0].smooth & ~whole[0].smooth
    assert set(zip(*np.nonzero(lost), strict=True)) == {(r, c) for r in range(38, 43) for c in range(48, 53)}
    assert (whole[1].smooth == seen[1].smooth).all()
    assert beside_lines(seen, []) is seen


def rounded(noise_m: float, width: int, step_m: float, rows_m: float = 0.0) -> tuple[ViewEvidence, ...]:
    """Views whose noise, of pixels and of whole rows, the camera averages over a window and rounds to its depth code."""
    rng, made = np.random.default_rng(7), []
    for k in range(12):
        r = rendering(0.05 * k)
        noise = rng.normal(0, noise_m, r.depth.shape) + rng.normal(0, rows_m, (len(r.depth), 1))
        depth = np.rint((r.depth + averaged(width)(noise)) / step_m) * step_m
        light = np.full(r.depth.shape, 1000.0 * (1 + k), np.float32)
        capture = Capture(k, CAMERA, depth.astype(np.float32), np.zeros(r.depth.shape, np.uint8), amplitude=light)
        made.append(replace(View.of_capture(capture), station=0, captures=1))
    return gather(made, [rendering(0.05 * k) for k in range(12)], None, EvidenceLimits(edge_px=0))  # type: ignore[arg-type]


def test_rounding_does_not_hide_a_filter() -> None:
    """1.5 mm of noise averaged over 5 x 5 pixels is 0.3 mm, and so is the rounding to millimetres: half of the variance is shared by 25 pixels."""
    seen = rounded(0.0015, 5, 0.001)
    assert seen[0].correlation.area == pytest.approx(13, rel=0.1)


def test_noise_of_rows_shows_through_steps_that_hide_the_noise_of_pixels() -> None:
    limits = GapConfig().noise
    (noise,) = noise_effects(rounded(0.0015, 5, 0.001, rows_m=0.004), limits)
    assert noise.name == "noise"
    assert noise.note.endswith("mm by rows")
    assert float(noise.note.split()[0]) == pytest.approx(4.0 / np.sqrt(5), rel=0.2)
    assert noise_effects(rounded(0.0015, 5, 0.001), limits) == []


def test_a_filter_is_no_noise_of_rows() -> None:
    rng = np.random.default_rng(2)
    seen = views(rng, np.stack([averaged(5)(rng.normal(0, 0.004, (86, 112))) for _ in range(12)]), photons=False)
    limits = GapConfig().noise.lines
    assert max(line_noise(seen, axis, limits).sigma for axis in (0, 1)) < limits.sigma


def test_noise_of_rows_through_a_filter_over_five_rows_has_its_size() -> None:
    rng = np.random.default_rng(9)
    raw = rng.normal(0, 0.004, (12, 86, 112)) + rng.normal(0, 0.004, (12, 86, 1))
    seen = views(rng, np.stack([averaged(5)(noise) for noise in raw]), photons=False)
    rows, columns = (line_noise(seen, axis, GapConfig().noise.lines) for axis in (1, 0))
    assert rows.size_m == pytest.approx(0.004 / np.sqrt(5), rel=0.15)
    assert rows.sigma > GapConfig().noise.lines.sigma > columns.sigma


@pytest.mark.parametrize(("factor", "found"), [(1.25, []), (2.0, ["interference"])])
def test_a_filter_that_averages_fewer_pixels_in_some_views_makes_no_burst(factor: float, found: list[str]) -> None:
    """Three of twelve views have this many times the noise of the others; independent noise of 1.25 times would be a burst."""
    quiet = views(np.random.default_rng(3))
    of_view = np.where(np.isin(np.arange(12), (1, 5, 9)), factor, 1.0)[:, None, None]
    noise = of_view * np.stack([(v.view.depth - v.frame.depth) * v.frame.length for v in quiet])
    limits = GapConfig().noise
    filtered = views(np.random.default_rng(3), np.stack([averaged(3)(n) for n in noise]), photons=False)
    assert [f.name for f in noise_effects(filtered, limits)] == found
    assert [f.name for f in noise_effects(views(np.random.default_rng(3), noise, photons=False), limits)] == ["interference"]


@pytest.mark.parametrize(("noise_m", "named"), [(0.0018, []), (0.0036, ["noise"])])
def test_constant_noise_of_a_filtered_camera_is_named_beyond_what_rounded_creases_leave(noise_m: float, named: list[str]) -> None:
    """Noise of one pixel before the filter; 3 x 3 pixels leave a third of it, 0.6 and 1.2 mm. The law is that of the photons alone."""
    quiet = views(np.random.default_rng(3))
    photons = np.stack([(v.view.depth - v.frame.depth) * v.frame.length for v in quiet]) * 0.3
    noise = photons + np.random.default_rng(6).normal(0, noise_m, photons.shape)
    alone, both = (views(np.random.default_rng(3), np.stack([averaged(3)(n) for n in made]), photons=False) for made in (photons, noise))
    law = own_law(alone, [], GapConfig().noise)
    assert [f.name for f in noise_effects(both, GapConfig().noise, law=law)] == named
    assert noise_effects(alone, GapConfig().noise, law=law) == []
