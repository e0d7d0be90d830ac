# SPDX-License-Identifier: Apache-2.0
"""Incidence is the geometric angle; mixed pixels are removed, surfaces are kept."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.tof_frames import CAMERA, captures, edge_rich, noise_of, plane
from tof_core.camera import Camera
from tof_core.reasons import Reason
from tof_preproc.config import FlyingConfig, GrazingConfig, PreprocConfig
from tof_preproc.frame import Frame
from tof_preproc.surface import AXES, _mixed, _mixed_among, cos_incidence, remove_flying, remove_grazing

LENS = Camera(160, 120, 150.0, 150.0, 79.5, 59.5, "plumb_bob", (-0.2, 0.05, 0.001, -0.001, 0.0))


def frame_of(depth: np.ndarray, sigma: float = 1e-4, camera: Camera = CAMERA) -> Frame:
    depth = depth.astype(np.float32)
    reason = np.where(np.isnan(depth), Reason.NO_RETURN, Reason.VALID).astype(np.uint8)
    return Frame(camera, depth, reason, np.full(depth.shape, sigma, np.float32))


@pytest.mark.parametrize("camera", [CAMERA, LENS])
@pytest.mark.parametrize("normal", [(0.0, 0.0, -1.0), (0.6, 0.0, -0.8), (-0.3, 0.8, -0.52), (0.0, 0.97, -0.24)])
def test_the_incidence_of_a_plane_is_the_angle_to_its_normal(camera: Camera, normal: tuple[float, float, float]) -> None:
    n = np.array(normal) / np.linalg.norm(normal)
    facing = -(camera.rays() @ n)
    depth = np.where(facing > 0.05, -n[2] / facing, np.nan)  # through (0, 0, 1)
    expected = facing / camera.ray_length()
    got = cos_incidence(depth.astype(np.float32), camera)
    inside = np.isfinite(depth) & (expected > 0.08)
    np.testing.assert_allclose(got[inside], expected[inside], atol=2e-3 if camera is CAMERA else 2e-2)


def test_grazing_removes_a_floor_where_it_gets_too_flat() -> None:
    y = CAMERA.rays()[..., 1]
    frame = frame_of(np.where(y > 0.02, 0.4 / np.maximum(y, 1e-9), np.nan))
    length = CAMERA.ray_length()
    remove_grazing(frame, PreprocConfig(grazing=GrazingConfig(max_deg=75.0)))
    incidence = np.rad2deg(np.arccos(np.clip(y / length, 0, 1)))
    assert (frame.reason[(incidence > 76) & (y > 0.02)] == Reason.GRAZING).all()
    assert (frame.reason[incidence < 74] == Reason.VALID).all()


def test_an_edge_between_two_walls_is_not_grazing() -> None:
    depth = np.full(CAMERA.shape, 1.0)
    depth[:, 200:] = 1.06
    assert remove_grazing(frame_of(depth), PreprocConfig(grazing=GrazingConfig(max_deg=60.0))) == 0


def test_one_mixed_column_between_two_walls_goes_and_nothing_else() -> None:
    depth = np.full(CAMERA.shape, 1.0)
    depth[:, 200], depth[:, 201:] = 1.13, 1.3
    frame = frame_of(depth)
    assert remove_flying(frame, PreprocConfig()) == CAMERA.height
    assert (frame.reason[:, 200] == Reason.FLYING).all()


@pytest.mark.parametrize("make", [lambda x, y: 1 + 0 * x, lambda x, y: 1 / (1 - x - 0.5 * y), lambda x, y: 1.2 - 0.5 * np.abs(x)])
def test_planes_and_creases_have_no_flying_pixels(make: object) -> None:
    rays = CAMERA.rays()
    assert callable(make)
    depth = make(rays[..., 0], rays[..., 1]) + 1e-3 * np.random.default_rng(0).standard_normal(CAMERA.shape)
    assert remove_flying(frame_of(depth, 1e-3), PreprocConfig()) == 0


def test_two_walls_without_a_mixed_pixel_lose_none() -> None:
    depth = np.full(CAMERA.shape, 1.0)
    depth[100:200, 150:250] = 0.8
    assert remove_flying(frame_of(depth), PreprocConfig()) == 0


@pytest.mark.parametrize(("count", "found"), [(1, 0.95), (10, 0.99)])
def test_mixed_pixels_of_an_edge_rich_frame_are_found_and_clean_ones_spared(count: int, found: float) -> None:
    truth = edge_rich()
    depth = np.mean([c.depth for c in captures(truth, count)], axis=0)
    frame = Frame(
        truth.camera, depth.astype(np.float32), np.zeros(depth.shape, np.uint8), (noise_of(truth) / np.sqrt(count)).astype(np.float32)
    )
    remove_flying(frame, PreprocConfig())
    off = np.abs(truth.depth - truth.surface)
    flying = frame.reason == Reason.FLYING
    assert flying[off > 0.01].mean() > found
    assert flying[off < 0.001].mean() < 0.006


def test_the_ratio_is_a_number_of_standard_deviations() -> None:
    depth = np.full(CAMERA.shape, 1.0)
    depth[:, 200], depth[:, 201:] = 1.0 + 5 * 1e-3 * np.sqrt(6), 1.3
    for ratio, gone in ((4.5, CAMERA.height), (5.5, 0)):
        assert remove_flying(frame_of(depth, 1e-3), PreprocConfig(flying=FlyingConfig(ratio=ratio))) == gone


def test_the_frames_planes_are_planes() -> None:
    truth = plane(incidence_deg=50.0)
    cosine = cos_incidence(truth.depth.astype(np.float32), truth.camera)
    assert np.rad2deg(np.arccos(cosine[150, 200])) == pytest.approx(50.0, abs=0.3)


def test_a_mixed_pixel_at_the_rim_of_a_hole_goes_and_a_clean_rim_stays() -> None:
    depth = np.full(CAMERA.shape, 1.0)
    depth[:, 201:] = np.nan
    depth[:150, 200] = 1.02
    frame = frame_of(depth, 1e-3)
    assert remove_flying(frame, PreprocConfig()) == 150
    assert (frame.reason[:150, 200] == Reason.FLYING).all()


@pytest.mark.parametrize("spread", [1e-4, 1e-3, 1e-2])
def test_the_passes_over_rows_settle_only_what_each_pixel_for_itself_gives(spread: float) -> None:
    depth = captures(edge_rich(), spikes=0.01, dropouts=0.05)[0].depth
    sigma, pitch = np.full(depth.shape, np.float32(spread)), CAMERA.pixel_angle * float(np.tan(np.deg2rad(70.0)))
    one_by_one = np.zeros(depth.shape, np.bool_)
    _mixed_among(depth, sigma, AXES, 4.0, pitch, np.zeros(1, np.bool_), 0, depth.shape[0], one_by_one)
    assert one_by_one.any()
    np.testing.assert_array_equal(_mixed(depth, sigma, AXES, 4.0, pitch), one_by_one)


def test_a_steep_plane_with_holes_has_no_flying_pixels() -> None:
    rng = np.random.default_rng(0)
    depth = 1 / (1 - CAMERA.rays()[..., 0]) + 1e-3 * rng.standard_normal(CAMERA.shape)
    depth[rng.random(CAMERA.shape) < 0.3] = np.nan
    assert remove_flying(frame_of(depth, 1e-3), PreprocConfig()) < 1e-4 * depth.size
