# SPDX-License-Identifier: Apache-2.0
"""A table of ray lengths that runs the wrong way: what it publishes, and that no other session is asked for it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.tof_sensor.plane import CAMERA, plane_frame
from tof_sensor.effects.z_conversion import ZConversion
from tof_sensor.session import Session, SessionView

ABOVE = replace(CAMERA, cx=CAMERA.cx + 2.0, cy=CAMERA.cy - 3.0, distortion=())


@pytest.mark.parametrize(("table", "row", "column"), [("rows", -1, 1), ("columns", 1, -1), ("both", -1, -1)])
def test_distance_is_divided_by_the_mirrored_pixel_s_ray(table: str, row: int, column: int) -> None:
    length = ABOVE.ray_length()
    distance = 0.8 * length
    published = 0.8 * ZConversion(table=table).published(ABOVE)
    np.testing.assert_allclose(published, distance / length[::row, ::column], rtol=1e-6)


def test_the_table_as_stated_changes_nothing() -> None:
    assert not ZConversion().bias(plane_frame()).any()


def test_below_the_middle_depth_grows_where_the_principal_point_lies_above_it() -> None:
    """Of a Kinect v2, to first order: dz = z s y / l^2 with s the rows by which the mirrored principal point lies lower, over f."""
    plain = plane_frame()
    frame = replace(plain, rays=ABOVE.rays(), rendering=replace(plain.rendering, camera=ABOVE))
    error = ZConversion(table="rows").bias(frame)[20, 20]
    s = (ABOVE.height - 1 - 2 * ABOVE.cy) / ABOVE.fy
    x, y = ABOVE.rays()[20, 20, :2]
    middle = y - s / 2  # The ratio of both lengths is exact to second order about the middle of both rays.
    assert error == pytest.approx(frame.depth[20, 20] * s * middle / (1 + x * x + middle * middle), rel=0.02)
    assert s > 0
    assert error > 0


def test_only_poses_that_depth_has_no_say_in_allow_a_test() -> None:
    seen = (SessionView(plane_frame(), np.arange(10)),)
    assert "record a checkerboard" in str(ZConversion.not_testable(Session(seen)))
    assert ZConversion.not_testable(Session(seen, posed_apart=True)) is None
    assert not list(ZConversion.hypotheses(Session(seen, posed_apart=True)))
