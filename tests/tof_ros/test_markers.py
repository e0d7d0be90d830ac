# SPDX-License-Identifier: Apache-2.0
"""The CAD as markers: where it is, in its colours, and never more triangles than a viewer draws."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="no ROS 2 here")
from tof_core import se3
from tof_ros.markers import GREEN, GREY, ORANGE, RED, coarse, part_markers, same_shade, shade
from tof_ros.messages import matrix

TRIANGLE = np.array([[0.0, 0, 0], [1, 0, 0], [0, 2, 0]])


def test_each_part_is_a_list_of_its_triangles_in_the_colour_of_what_is_known() -> None:
    parts = [("plate", TRIANGLE, np.array([[0, 1, 2]])), ("clip", TRIANGLE + 1, np.array([[0, 1, 2]]))]
    markers = part_markers(parts, "cell", {"clip": RED}).markers
    assert [(m.text, m.id, m.ns, m.header.frame_id) for m in markers] == [("plate", 0, "scene", "cell"), ("clip", 1, "scene", "cell")]
    assert [(p.x, p.y, p.z) for p in markers[0].points] == [(0, 0, 0), (1, 0, 0), (0, 2, 0)]
    colours = [(round(m.color.r, 3), round(m.color.g, 3), round(m.color.b, 3)) for m in markers]
    assert colours == [GREY, RED]
    assert markers[0].color.a < markers[1].color.a


def test_in_another_frame_than_the_cell_s_the_parts_stand_where_the_cell_is() -> None:
    T_odom_cell = se3.from_quat((1.0, 2.0, 0.5), (0.0, 0.0, 1.0, 0.0))
    (marker,) = part_markers([("plate", TRIANGLE, np.array([[0, 1, 2]]))], "odom", {}, T_frame_cell=T_odom_cell).markers
    assert marker.header.frame_id == "odom"
    np.testing.assert_allclose(matrix(marker.pose), T_odom_cell, atol=1e-12)


def test_a_fine_mesh_is_drawn_coarser_and_keeps_its_place() -> None:
    n = 200
    u, v = np.meshgrid(np.linspace(0, 1, n), np.linspace(0, 1, n))
    vertices = np.stack([u, v, 0.1 * np.sin(6 * u)], axis=-1).reshape(-1, 3)
    at = np.arange(n * n).reshape(n, n)
    a, b, c, d = at[:-1, :-1], at[:-1, 1:], at[1:, :-1], at[1:, 1:]
    faces = np.concatenate([np.stack([a, b, c], axis=-1).reshape(-1, 3), np.stack([b, d, c], axis=-1).reshape(-1, 3)])
    assert len(faces) > 70_000
    at_most, triangles = coarse(vertices, faces, most=5000)
    assert 500 < len(triangles) <= 5000
    corners = at_most[triangles]
    assert np.abs(corners[..., 2] - 0.1 * np.sin(6 * corners[..., 0])).max() < 1e-9
    assert np.ptp(corners[..., 0]) > 0.97


def test_a_gap_is_green_orange_or_red() -> None:
    assert (shade(0.0), shade(0.5), shade(1.0), shade(7.0)) == (GREEN, ORANGE, RED, RED)
    assert shade(0.25)[0] == pytest.approx((GREEN[0] + ORANGE[0]) / 2)
    assert same_shade(1.0, 1.1, 5.0)
    assert not same_shade(1.0, 2.0, 5.0)
    assert not same_shade(None, 0.0, 5.0)
