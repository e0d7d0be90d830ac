# SPDX-License-Identifier: Apache-2.0
"""The raster finds the neighbours that a k-d tree finds."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial import cKDTree

from benchmarks.tof_frames import CAMERA, captures, edge_rich, plane
from tof_core.camera import Camera
from tof_preproc.neighbours import Neighbourhood, mean_distance

if TYPE_CHECKING:
    from tof_core.arrays import Image

LENS = Camera(160, 120, 150.0, 140.0, 70.5, 59.5, "plumb_bob", (-0.2, 0.05, 0.001, -0.001, 0.0))


def by_tree(depth: Image, camera: Camera, k: int) -> Image:
    points = camera.points(depth).reshape(-1, 3)
    known = np.isfinite(points).all(axis=1)
    distance, _ = cKDTree(points[known]).query(points[known], k)
    out = np.full(depth.size, np.nan, np.float32)
    out[known] = distance.reshape(int(known.sum()), -1).mean(axis=1)
    return out.reshape(depth.shape)


@pytest.mark.parametrize("noise", [0.0, 1.0, 10.0])
@pytest.mark.parametrize("incidence", [0.0, 70.0])
def test_on_a_plane_clean_or_noisy_or_steep(noise: float, incidence: float) -> None:
    depth = captures(plane(incidence_deg=incidence), noise=noise)[0].depth
    got, expected = mean_distance(depth, CAMERA, 20), by_tree(depth, CAMERA, 20)
    assert np.quantile(np.abs(got / expected - 1), [0.5, 0.999]) == pytest.approx([0, 0], abs=4e-3)


def test_among_edges_spikes_and_holes() -> None:
    depth = captures(edge_rich(), spikes=0.02, dropouts=0.3)[0].depth
    depth[100:150, 200:300] = np.nan
    got, expected = mean_distance(depth, CAMERA, 20), by_tree(depth, CAMERA, 20)
    np.testing.assert_array_equal(np.isnan(got), np.isnan(expected))
    off = np.abs(got / expected - 1)[np.isfinite(got)]
    assert np.quantile(off, 0.99) < 5e-3
    assert np.quantile(off, 0.995) < 0.05  # beyond: spikes alone in the air, whose neighbours are outside the search


@given(
    arrays(np.float32, (9, 13), elements=st.one_of(st.just(np.nan), st.floats(0.25, 4.0, width=32))),
    st.integers(2, 30),
)
def test_on_rasters_smaller_than_a_window(depth: Image, k: int) -> None:
    camera = Camera(13, 9, 60.0, 60.0, 6.0, 4.0)
    known = int(np.isfinite(depth).sum())
    if known:
        np.testing.assert_allclose(mean_distance(depth, camera, k), by_tree(depth, camera, min(k, known)), rtol=0.02, atol=1e-6)


def test_through_a_lens_that_bends() -> None:
    depth = (1.2 + 0.2 * LENS.rays()[..., 0] + 1e-3 * np.random.default_rng(0).standard_normal(LENS.shape)).astype(np.float32)
    np.testing.assert_allclose(mean_distance(depth, LENS, 20), by_tree(depth, LENS, 20), rtol=0.03)


@pytest.mark.parametrize("shape", [(1, 1), (1, 40), (40, 1)])
def test_rasters_of_one_line(shape: tuple[int, int]) -> None:
    camera = Camera(shape[1], shape[0], 60.0, 60.0, 0.0, 0.0)
    depth = np.ones(shape, np.float32)
    k = min(5, depth.size)
    np.testing.assert_allclose(mean_distance(depth, camera, 5), by_tree(depth, camera, k), rtol=1e-3, atol=1e-7)


@pytest.mark.parametrize(("at_rims", "share"), [(False, 0.7), (True, 0.85)])
def test_a_pixel_is_dense_only_where_the_tree_finds_as_many_points(at_rims: bool, share: float) -> None:  # noqa: FBT001  (a case)
    capture = captures(edge_rich(), spikes=0.02, dropouts=0.05)[0]
    points = CAMERA.points(capture.depth).reshape(-1, 3)
    known = np.isfinite(points).all(axis=1)
    kth = np.full(capture.depth.size, np.inf)
    kth[known] = cKDTree(points[known]).query(points[known], 20)[0][:, -1]
    within = np.float32(5.0) * capture.depth * np.float32(CAMERA.pixel_angle)
    dense = np.array(known)
    dense[Neighbourhood(capture.depth, CAMERA, 20).doubtful(within, at_rims=at_rims)] = False
    assert not (dense & (kth > 1.0001 * within.ravel())).any()
    assert dense[known].mean() > share


@pytest.mark.parametrize("multiple", [1.2, 2.2, 4.0])
def test_a_pixel_is_beyond_a_limit_where_the_trees_mean_distance_is(multiple: float) -> None:
    depth = captures(edge_rich(), spikes=0.02, dropouts=0.3)[0].depth
    expected = by_tree(depth, CAMERA, 20).ravel()
    pixels = np.flatnonzero(np.isfinite(expected))
    limit = (multiple * np.float32(1.7) * depth * np.float32(CAMERA.pixel_angle)).ravel()[pixels]
    off = expected[pixels] / limit - 1
    clear = np.abs(off) > 5e-3  # what mean_distance itself is exact to
    beyond = Neighbourhood(depth, CAMERA, 20).beyond(pixels, limit)
    assert 0.005 < beyond.mean() < 0.9
    assert np.count_nonzero((beyond != (off > 0))[clear]) <= 1e-4 * pixels.size


def test_windows_that_reach_less_far_than_the_kth_point_may_be_left_out() -> None:
    depth = captures(edge_rich(), spikes=0.02)[0].depth
    cloud = Neighbourhood(depth, CAMERA, 20)
    pixels = np.flatnonzero(cloud.known)[::7]
    whole = cloud.mean_distance(pixels)
    far = whole > np.quantile(whole, 0.95)
    np.testing.assert_allclose(cloud.mean_distance(pixels[far], float(whole[far].min())), whole[far], rtol=5e-3)


def test_an_empty_frame_stays_empty() -> None:
    assert np.isnan(mean_distance(np.full(CAMERA.shape, np.nan, np.float32), CAMERA, 20)).all()
