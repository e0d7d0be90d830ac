# SPDX-License-Identifier: Apache-2.0
"""The floor: noise as its own pixels show it, and the posterior of the pose."""

from __future__ import annotations

import numpy as np
import pytest

from tests.tof_gap.quiet_views import SHAPE, views
from tof_gap.tell.figures.floor import floor2, shown2
from tof_sensor.geometry import pose_columns

RNG = np.random.default_rng(2)
STATED = [np.full(SHAPE, 0.002**2)]


def test_the_floor_is_noise_and_pose_posterior() -> None:
    (view, *_) = views(np.random.default_rng(1))
    along = np.zeros((6, 6))
    along[2, 2] = 0.002**2
    (only_noise,), (both,) = floor2([view], np.zeros((1, 6, 6))), floor2([view], along[None])
    np.testing.assert_allclose(only_noise, view.sigma**2)
    # A step along the optical axis changes depth by itself, and by the slope of the surface.
    np.testing.assert_allclose(both - only_noise, 0.002**2 * pose_columns(view.frame)[..., 2] ** 2)
    assert np.sqrt((both - only_noise)[SHAPE[0] // 2, SHAPE[1] // 2]) == pytest.approx(0.002, rel=0.3)


def total(shown: list) -> float:  # type: ignore[type-arg]
    return float(shown[0].sum() / STATED[0].sum())


def test_the_noise_shown_is_that_of_these_very_pixels() -> None:
    noise = RNG.normal(0, 1.03 * 0.002, SHAPE)
    assert total(shown2([noise], STATED, 0.2, 4)) == pytest.approx((noise**2).sum() / STATED[0].sum(), rel=0.02)


def test_a_smooth_gap_is_no_noise() -> None:
    row, column = np.mgrid[: SHAPE[0], : SHAPE[1]]
    gap = 0.003 * np.sin(row / 20) * np.cos(column / 15)
    noise = RNG.normal(0, 0.002, SHAPE)
    assert total(shown2([noise + gap], STATED, 0.2, 4)) == pytest.approx(total(shown2([noise], STATED, 0.2, 4)), rel=0.02)


def test_noise_that_next_neighbours_share_is_noise() -> None:
    """Means of two neighbours: the second differences of such noise have two thirds of its variance, squares of four all."""
    white = RNG.normal(0, 0.002, (SHAPE[0], SHAPE[1] + 1))
    shared = (white[:, 1:] + white[:, :-1]) / np.sqrt(2.0)
    assert total(shown2([shared], STATED, 0.5, 4)) == pytest.approx(1.0, abs=0.04)


def test_noise_of_rows_and_columns_is_noise() -> None:
    lines = RNG.normal(0, 0.001, (SHAPE[0], 1)) + RNG.normal(0, 0.001, (1, SHAPE[1]))
    assert total(shown2([RNG.normal(0, 0.002, SHAPE) + lines], STATED, 0.9, 4)) == pytest.approx(1.5, abs=0.15)


@pytest.mark.parametrize(("sigma", "bound"), [(0.003, 1.06), (0.001, 0.94)])
def test_what_differs_from_the_stated_noise_by_more_than_it_is_known_is_not_the_floor(sigma: float, bound: float) -> None:
    """Gross errors are shared by no neighbour, as noise is."""
    assert total(shown2([RNG.normal(0, sigma, SHAPE)], STATED, 0.06, 4)) == pytest.approx(bound)


def test_pixels_without_neighbours_are_as_noisy_as_they_show() -> None:
    """Every fourth pixel of a row is lonely and three times as noisy as its amplitude says; a gap of 2 mm is in all of them."""
    noise = RNG.normal(0, 0.002, SHAPE)
    lonely = np.zeros(SHAPE, bool)
    lonely[::8, ::4] = True
    noise[lonely] *= 3.0
    kept = np.where(lonely, noise, np.nan)
    kept[4:8] = noise[4:8]
    expected = np.nansum(kept**2) / np.isfinite(kept).sum() / 0.002**2
    (shown,) = shown2([kept + 0.002], STATED, 5.0, 4)
    seen = np.isfinite(kept)
    assert shown[seen].mean() / 0.002**2 == pytest.approx(expected, rel=0.05)
    np.testing.assert_array_equal(shown[~seen], STATED[0][~seen])


def test_a_single_pixel_is_bounded_by_the_stated_noise() -> None:
    alone = np.full(SHAPE, np.nan)
    alone[5, 5] = 0.001
    (shown,) = shown2([alone], STATED, 0.06, 4)
    assert shown[5, 5] == pytest.approx(0.94 * 0.002**2)
    np.testing.assert_array_equal(shown[np.isnan(alone)], STATED[0][np.isnan(alone)])
