# SPDX-License-Identifier: Apache-2.0
"""Pixels with a noise of their own: those around them are quiet, and both halves of the views show them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import map_coordinates, uniform_filter

from tests.tof_gap.quiet_views import SHAPE, VIEWS, views
from tof_gap.compare.noise_parts import OF_PIXELS, measured
from tof_gap.limits.noise import NoiseLimits, PixelLimits
from tof_gap.seen.evidence.pattern import beside_pixels, single_pixels
from tof_gap.seen.noise.effects import noise_effects, pixels_found
from tof_gap.seen.noise.pixels import INTERPOLATED, halves_agree, noise_by_view, noisy_pixels, variance_elsewhere

LIMITS = PixelLimits()


def noise() -> np.ndarray:
    """(V, H, W) of unit variance."""
    return np.random.default_rng(7).standard_normal((VIEWS, *SHAPE))


def test_pixels_that_are_noisy_in_every_view_are_so_in_both_halves() -> None:
    where = np.random.default_rng(3).random(SHAPE) < 0.02
    seen = views(np.random.default_rng(2), 0.03 * noise() * where)
    found = noisy_pixels(seen, LIMITS)
    assert (found.where & where).sum() > 0.9 * where[5:-5, 5:-5].sum()
    assert found.size_m == pytest.approx(0.03, rel=0.5)
    assert halves_agree(seen, LIMITS) > 1.5


def test_steps_of_the_depth_code_wider_than_the_noise_hide_no_noisy_pixels() -> None:
    """A code of 1 mm beside 0.6 mm of noise; a fiftieth of the pixels jumps by a centimetre."""
    where = np.random.default_rng(3).random(SHAPE) < 0.02
    extra = np.round((0.0006 * noise() + 0.01 * np.random.default_rng(8).standard_normal((VIEWS, *SHAPE)) * where) / 0.001) * 0.001
    seen = [replace(v, step_m=0.001) for v in views(np.random.default_rng(2), extra, photons=False)]
    found = noise_effects(seen, NoiseLimits())
    assert [f.name for f in found] == ["noise"]
    assert found[0].own_noise is not None
    assert (found[0].own_noise & where).sum() > 0.9 * where[5:-5, 5:-5].sum()
    quiet = [replace(v, step_m=0.001) for v in views(np.random.default_rng(2), np.round(0.6 * noise()) * 0.001, photons=False)]
    assert noise_effects(quiet, NoiseLimits()) == []


def test_pixels_with_long_tails_that_differ_from_view_to_view_do_not_repeat() -> None:
    tails = np.random.default_rng(5).random((VIEWS, *SHAPE)) < 0.3
    seen = views(np.random.default_rng(2), 0.02 * noise() * tails)[:8]
    assert noisy_pixels(seen, LIMITS).share > NoiseLimits().pixel_share
    assert abs(halves_agree(seen, LIMITS)) < 0.2
    assert not [f for f in noise_effects(seen, NoiseLimits()) if f.own_noise is not None]


def test_a_region_that_is_noisier_than_its_law_has_no_noisy_pixels() -> None:
    """A corner of 48 x 48 pixels with three times the noise that is predicted: no pixel of it is noisier than those around it."""
    seen = views(np.random.default_rng(2))
    low = np.ones(SHAPE)
    low[:48, :48] = 1 / 3
    seen = tuple(replace(v, sigma=v.sigma * low) for v in seen)
    assert noisy_pixels(seen, replace(LIMITS, around_px=256)).share > NoiseLimits().pixel_share
    assert noisy_pixels(seen, LIMITS).share < 0.001


def test_neighbours_that_an_average_takes_in_by_chance_are_no_unstable_pixels() -> None:
    """A fiftieth of the pixels jumps by 30 mm from view to view, 4 mm RMS over the image, beside constant offsets of 20 mm or none."""
    offsets = 0.02 * np.random.default_rng(4).standard_normal(SHAPE)
    where = np.random.default_rng(3).random(SHAPE) < 0.02
    jumps = 0.03 * np.random.default_rng(8).standard_normal((VIEWS, *SHAPE)) * where
    beside, alone = (views(np.random.default_rng(2), of + jumps) for of in (offsets, 0.0 * offsets))
    found = noisy_pixels(beside_pixels(beside, single_pixels(beside)), LIMITS)
    assert found.rms_m == pytest.approx(found.size_m * np.sqrt(found.share))
    assert pixels_found(alone, NoiseLimits()) is not None
    assert pixels_found(beside, NoiseLimits()) is None
    assert [measured(seen, NoiseLimits())[OF_PIXELS].named for seen in (alone, beside)] == [True, False], "as sessions are compared"
    assert pixels_found(beside, NoiseLimits(pixels=PixelLimits(of_offsets=0.05))) is not None


def test_views_that_see_nothing_have_no_noisy_pixels() -> None:
    blind = [replace(v, smooth=np.zeros(SHAPE, bool)) for v in views(np.random.default_rng(2))]
    assert noisy_pixels(blind, LIMITS).share == 0.0
    assert halves_agree(blind, LIMITS) == 0.0
    assert variance_elsewhere(blind, LIMITS) == 1.0


def test_unstable_pixels_repeat_where_a_camera_averages_over_their_neighbours() -> None:
    """A fiftieth of the pixels jumps; the average over 3 x 3 pixels leaves a ninth of each jump on nine of them."""
    where = np.random.default_rng(3).random(SHAPE) < 0.02
    jumps = np.random.default_rng(8).standard_normal((VIEWS, *SHAPE)) * where
    seen, quiet = (
        views(np.random.default_rng(2), np.stack([uniform_filter(n, 3) for n in 0.005 * noise() + size * jumps]), photons=False)
        for size in (0.03, 0.0)
    )
    assert halves_agree(seen, LIMITS) > 1.0
    assert abs(halves_agree(quiet, LIMITS)) < 0.3


def test_pixels_of_an_interpolating_driver_differ_in_noise_and_are_not_unstable() -> None:
    """Noise of 5 mm in the grid of a barrel lens: a pixel on one of the grid's has more noise than one between four of them."""
    from_centre = np.mgrid[: SHAPE[0], : SHAPE[1]] - np.reshape(SHAPE, (2, 1, 1)) / 2
    where = from_centre * (0.97 - 0.06 * (from_centre**2).sum(axis=0) / SHAPE[0] ** 2) + np.reshape(SHAPE, (2, 1, 1)) / 2
    between = np.stack([map_coordinates(0.005 * n, where, order=1) for n in noise()])
    unstable = np.random.default_rng(3).random(SHAPE) < 0.02
    jumps = 0.03 * np.random.default_rng(8).standard_normal((VIEWS, *SHAPE)) * unstable
    even, uneven = (views(np.random.default_rng(2), between + of, photons=False) for of in (0.0 * jumps, jumps))
    assert 2.0 < variance_elsewhere(even, LIMITS) < INTERPOLATED
    assert halves_agree(even, LIMITS) > LIMITS.repeated, "the same pixels are noisy"
    assert pixels_found(even, NoiseLimits()) is None
    assert variance_elsewhere(uneven, LIMITS) > 2.0 * INTERPOLATED
    assert pixels_found(uneven, NoiseLimits()) is not None


def test_whole_lines_that_are_noisy_are_no_unstable_pixels() -> None:
    column = np.where(np.random.default_rng(3).random(SHAPE[1]) < 0.1, 0.03, 0.0)
    seen = views(np.random.default_rng(2), column * noise())
    assert halves_agree(seen, LIMITS) < LIMITS.repeated
    assert noisy_pixels(seen, LIMITS).share > NoiseLimits().pixel_share


def test_little_noise_of_single_pixels_is_a_usual_cameras() -> None:
    where = np.random.default_rng(3).random(SHAPE) < 0.02
    for of_pixel_m, names in ((0.0006, []), (0.02, ["noise"])):
        extra = of_pixel_m * np.random.default_rng(8).standard_normal((VIEWS, *SHAPE)) * where
        found = [f for f in noise_effects(views(np.random.default_rng(2), extra), NoiseLimits()) if f.own_noise is not None]
        assert [f.name for f in found] == names


def test_the_noise_of_those_pixels_is_known_in_each_view() -> None:
    """30 mm in every view but the first, which has 10."""
    where = np.random.default_rng(3).random(SHAPE) < 0.02
    size = np.where(np.arange(VIEWS) == 0, 0.01, 0.03)[:, None, None]
    by_view = noise_by_view(views(np.random.default_rng(2), size * noise() * where), where)
    assert by_view[1:] == pytest.approx(0.03 * np.sqrt(1 / 1.5), rel=0.2)
    assert by_view[0] == pytest.approx(by_view[1:].mean() / 3, rel=0.25)
