# SPDX-License-Identifier: Apache-2.0
"""The raster of a view and the noise its pixels are given."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.tof_align.made import CONFIG, one_view, section
from tof_align.pixels import raster_step, take_pixels
from tof_core.camera import Camera


def test_the_raster_holds_every_nth_pixel_with_its_own_ray_and_depth() -> None:
    view, _ = one_view(section(), np.zeros(6))
    pixels = take_pixels(view, CONFIG.weights, pixels=600)
    step = raster_step(view.camera, 600)
    assert step == 4
    v, u = np.divmod(pixels.index, view.camera.width)
    assert np.all(np.diff(u, axis=1) == step)
    assert np.all(np.diff(v, axis=0) == step)
    np.testing.assert_array_equal(pixels.depth, view.depth[v, u].astype(float))
    np.testing.assert_array_equal(pixels.rays, view.camera.rays()[v, u])


def test_a_small_camera_gives_all_its_pixels() -> None:
    assert raster_step(Camera(60, 40, 50.0, 50.0, 30.0, 20.0), 8000) == 1


def test_sigma_pools_the_scatter_of_few_captures_with_the_neighbours() -> None:
    view, _ = one_view(section(), np.zeros(6))
    rng = np.random.default_rng(0)
    true = 1e-3
    told = true * np.sqrt(rng.chisquare(2, view.depth.shape) / 2)
    view = replace(view, sigma=told.astype(np.float32), count=np.full(view.depth.shape, 3, np.uint16))
    sigma = take_pixels(view, CONFIG.weights).sigma
    middle = sigma[4:-4, 4:-4]
    assert np.median(middle) == pytest.approx(true, rel=0.05)
    assert middle.std() < 0.4 * told.std()


def test_without_scatter_the_configured_noise_is_taken() -> None:
    view, _ = one_view(section(), np.zeros(6))
    view = replace(view, sigma=np.full(view.depth.shape, np.nan, np.float32), count=np.full(view.depth.shape, 4, np.uint16))
    expected = np.hypot(CONFIG.weights.noise_mm / 2, CONFIG.weights.floor_mm) * 1e-3
    np.testing.assert_allclose(take_pixels(view, CONFIG.weights).sigma, expected)
