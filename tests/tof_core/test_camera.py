# SPDX-License-Identifier: Apache-2.0
"""The camera model: rays and pixels undo each other and agree with OpenCV."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.radial import z_to_radial
from tof_core.camera import Camera, radial_to_z
from tof_core.errors import CameraError

PINHOLE = Camera(64, 48, 60.0, 61.0, 31.2, 24.1)
PLUMB_BOB = replace(PINHOLE, distortion=(-0.12, 0.03, 1e-3, -2e-3, 0.01))
RATIONAL = Camera(
    640, 576, 504.6, 504.7, 332.8, 348.8, "rational_polynomial", (0.548, -0.021, 2.1e-5, -7.2e-5, -2.7e-3, 0.890, 0.086, -0.0139)
)
"""A real Azure Kinect's numbers, rounded."""
MODELS = pytest.mark.parametrize("camera", [PINHOLE, PLUMB_BOB, RATIONAL], ids=["pinhole", "plumb_bob", "rational"])


@MODELS
def test_projecting_the_rays_gives_the_pixels(camera: Camera) -> None:
    v, u = np.mgrid[: camera.height, : camera.width]
    np.testing.assert_allclose(camera.project(2.7 * camera.rays()), np.stack([u, v], -1), atol=1e-8)


@MODELS
def test_projection_agrees_with_opencv(camera: Camera) -> None:
    import cv2

    points = np.random.default_rng(2).uniform([-0.3, -0.3, 0.6], [0.3, 0.3, 2.0], (500, 3))
    d = np.array([*camera.distortion, *(0.0,) * 8][:8])
    expected = cv2.projectPoints(points, np.zeros(3), np.zeros(3), camera.K, d)[0][:, 0]
    np.testing.assert_allclose(camera.project(points), expected, atol=1e-9)


@MODELS
def test_rays_agree_with_opencv(camera: Camera) -> None:
    import cv2

    uv = np.random.default_rng(3).uniform([0, 0], [camera.width - 1, camera.height - 1], (300, 2))
    d = np.array([*camera.distortion, *(0.0,) * 8][:8])
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 500, 1e-14)
    expected = cv2.undistortPoints(uv[:, None], camera.K, d, None, None, None, criteria)[:, 0]
    np.testing.assert_allclose(camera.rays_at(uv)[:, :2], expected, atol=1e-6)


@given(st.floats(-0.3, 0.3), st.floats(-0.1, 0.1), st.floats(-3e-3, 3e-3), st.floats(-3e-3, 3e-3), st.floats(-0.05, 0.05))
def test_undistortion_undoes_distortion_or_gives_nan(k1: float, k2: float, p1: float, p2: float, k3: float) -> None:
    camera = replace(PINHOLE, distortion=(k1, k2, p1, p2, k3))
    uv = np.stack(np.meshgrid([0.0, 20.0, 63.0], [0.0, 24.0, 47.0]), -1)
    rays = camera.rays_at(uv)
    known = np.asarray(np.isfinite(rays).all(axis=-1))
    assert bool(known[1, 1])
    np.testing.assert_allclose(camera.project(rays[known]), uv[known], atol=1e-6)


def test_points_beyond_the_fold_of_the_polynomial_are_not_in_the_picture() -> None:
    camera = replace(PINHOLE, distortion=(-0.3, 0.0, 0.0, 0.0, 0.0))
    # r (1 - 0.3 r^2) turns back at r = 1.054 and comes to the centre again at r = 1.826.
    assert np.isfinite(camera.project([1.0, 0.0, 1.0])).all()
    assert np.isnan(camera.project([1.8, 0.0, 1.0])).all()


def test_points_behind_the_camera_are_nowhere() -> None:
    assert np.isnan(PINHOLE.project([[0.1, 0.1, -1.0], [0.1, 0.1, 0.0]])).all()


@MODELS
def test_radial_and_z_are_each_other_s_inverse(camera: Camera) -> None:
    depth = np.random.default_rng(4).uniform(0.3, 4.0, camera.shape).astype(np.float32)
    radial = z_to_radial(camera, depth)
    np.testing.assert_allclose(radial, np.linalg.norm(camera.points(depth), axis=-1), rtol=1e-6)
    np.testing.assert_allclose(radial_to_z(camera, radial), depth, rtol=3e-7)


def test_a_finer_raster_sees_the_same() -> None:
    fine = PINHOLE.scaled(4)
    assert fine.shape == (192, 256)
    centres = np.stack(np.meshgrid(np.arange(64), np.arange(48)), -1)
    np.testing.assert_allclose(fine.rays_at(4 * centres + 1.5), PINHOLE.rays(), atol=1e-12)


def test_rays_are_computed_once_and_are_read_only() -> None:
    assert PINHOLE.rays() is replace(PINHOLE).rays()
    with pytest.raises(ValueError, match="read-only"):
        PINHOLE.rays()[0, 0, 0] = 1.0


@pytest.mark.parametrize("changes", [{"fx": 0.0}, {"fx": -1.0}, {"cy": float("nan")}, {"height": 0}])
def test_what_is_no_camera_is_refused(changes: dict[str, float]) -> None:
    with pytest.raises(CameraError):
        replace(PINHOLE, **changes)  # type: ignore[arg-type]
