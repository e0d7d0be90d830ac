# SPDX-License-Identifier: Apache-2.0
"""The robot for closed loops."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from tests.tof_virtual.made import bench, config
from tof_core import se3
from tof_virtual.live import VirtualRobot


def test_a_capture_is_what_the_true_pose_sees() -> None:
    robot = VirtualRobot(bench(), config())
    shots = [robot.capture() for _ in range(3)]
    assert [b.stamp_ns - a.stamp_ns for a, b in itertools.pairwise(shots)] == [pytest.approx(1e9 / 15, abs=2)] * 2
    error = shots[0].depth - robot._seen().z.reshape(robot.camera.shape)
    assert abs(np.nanmedian(error)) < 3e-4
    assert (shots[0].depth != shots[1].depth).any(), "photons differ from capture to capture"
    assert shots[0].amplitude is not None
    assert shots[0].robot is not None
    np.testing.assert_allclose(shots[0].robot.T_cell_camera, robot.T_cell_camera)
    metres, degrees = se3.distance(robot.T_cell_camera, robot.T_cell_camera_true)
    assert 0.015 < metres < 0.12
    assert degrees < 3


def test_moving_by_what_is_asked_moves_the_camera_by_it_within_the_arms_error() -> None:
    robot = VirtualRobot(bench(), config())
    before, believed = robot.T_cell_camera_true, robot.T_body_hand
    robot.goto(believed @ se3.exp([0.02, 0.0, 0.0, 0.0, 0.0, 0.0]))
    moved = se3.distance(before, robot.T_cell_camera_true)[0]
    assert moved == pytest.approx(0.02, abs=0.004)
    robot.goto(believed)
    back_mm = 1e3 * se3.distance(before, robot.T_cell_camera_true)[0]
    assert 0 < back_mm < 1.5, "the arm comes back to within what does not repeat"


def test_driving_away_and_back_misses_the_mark() -> None:
    robot = VirtualRobot(bench(), config())
    before = robot.T_cell_camera_true
    robot.drive(robot.T_cell_body)
    assert se3.distance(before, robot.T_cell_camera_true)[0] > 0.005


def test_colour_comes_with_its_camera_and_place() -> None:
    colour = VirtualRobot(bench(), config()).capture(colour=True).colour
    assert colour is not None
    assert colour.image.shape == (480, 640, 3)
    assert colour.camera is not None
    assert colour.camera.frame_id == "hand_color_image_sensor"
    assert colour.T_camera_colour is not None
    assert np.linalg.norm(colour.T_camera_colour[:3, 3]) == pytest.approx(0.025)
    assert colour.image.std() > 10
