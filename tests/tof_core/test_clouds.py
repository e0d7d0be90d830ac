# SPDX-License-Identifier: Apache-2.0
"""Point clouds give the depth image they were made of."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tof_core import se3
from tof_core.camera import Camera
from tof_core.clouds import cloud_fields, depth_from_points
from tof_core.encode import points_fields
from tof_core.errors import DecodeError
from tof_core.reasons import Reason

CAMERA = Camera(32, 24, 30.0, 31.0, 15.2, 11.7)
DEPTH = np.random.default_rng(0).uniform(0.5, 2.0, CAMERA.shape).astype(np.float32)
DEPTH[3:6, 4:9] = np.nan
POINTS = CAMERA.points(DEPTH)


def cloud(points: Any, intensity: Any = None) -> SimpleNamespace:
    return SimpleNamespace(**points_fields(points, intensity))


def test_an_organised_cloud_keeps_its_raster() -> None:
    depth, reason = depth_from_points(cloud(POINTS, DEPTH), CAMERA)
    np.testing.assert_allclose(depth, DEPTH, rtol=1e-7)
    np.testing.assert_array_equal(reason, np.where(np.isnan(DEPTH), Reason.NO_RETURN, Reason.VALID))


def test_a_flat_cloud_in_any_order_is_projected_to_the_same_image() -> None:
    flat = POINTS[np.isfinite(DEPTH)]
    np.random.default_rng(1).shuffle(flat)
    np.testing.assert_allclose(depth_from_points(cloud(flat), CAMERA)[0], DEPTH, rtol=1e-6)


def test_an_organised_cloud_on_another_raster_is_projected() -> None:
    mirrored = np.ascontiguousarray(POINTS[:, ::-1])
    np.testing.assert_allclose(depth_from_points(cloud(mirrored), CAMERA)[0], DEPTH, rtol=1e-6)


def test_a_cloud_in_another_frame_is_brought_into_the_camera_s() -> None:
    T = se3.exp([0.3, -0.2, 0.5, 0.4, 0.2, -0.3])
    depth, _ = depth_from_points(cloud(se3.apply(se3.inverse(T), POINTS)), CAMERA, T)
    np.testing.assert_allclose(depth, DEPTH, atol=2e-6)


def test_of_several_points_in_a_pixel_the_nearest_is_seen() -> None:
    ray = CAMERA.rays()[10, 12]
    depth, _ = depth_from_points(cloud(np.array([2.0, 0.7, 1.1])[:, None] * ray), CAMERA)
    assert depth[10, 12] == pytest.approx(0.7)
    assert np.isfinite(depth).sum() == 1


def test_points_behind_and_beside_are_not_in_the_picture() -> None:
    depth, reason = depth_from_points(cloud([[0.0, 0.0, -1.0], [5.0, 0.0, 1.0], [np.nan, 0.0, 1.0]]), CAMERA)
    assert np.isnan(depth).all()
    assert (reason == Reason.NO_RETURN).all()


@given(st.integers(0, 9), st.booleans(), st.sampled_from(["f4", "f8"]))
def test_padding_byte_order_and_element_type_are_honoured(padding: int, bigendian: bool, element: str) -> None:  # noqa: FBT001
    values = np.arange(24, dtype=element).reshape(2, 4, 3)
    size = values.dtype.itemsize
    fields = [SimpleNamespace(name=n, offset=2 + size * i, datatype={4: 7, 8: 8}[size], count=1) for i, n in enumerate("xyz")]
    step = 2 + 3 * size
    rows = bytearray()
    for row in values:
        for point in row:
            rows += b"\x7f\x7f" + point.astype(f"{'>' if bigendian else '<'}{element}").tobytes()
        rows += bytes(padding)
    msg = SimpleNamespace(
        height=2, width=4, fields=fields, is_bigendian=bigendian, point_step=step, row_step=4 * step + padding, data=bytes(rows)
    )
    np.testing.assert_array_equal(np.stack(cloud_fields(msg, ("x", "y", "z")), -1), values)


def test_a_cloud_without_z_or_with_too_few_bytes_is_refused() -> None:
    msg = cloud(POINTS)
    msg.data = msg.data[:-4]
    with pytest.raises(DecodeError, match="does not fit"):
        depth_from_points(msg, CAMERA)
    msg = cloud(POINTS)
    msg.fields = msg.fields[:2]
    with pytest.raises(DecodeError, match="/points: cloud has no field 'z'; its fields are x, y"):
        depth_from_points(msg, CAMERA, where="/points")
