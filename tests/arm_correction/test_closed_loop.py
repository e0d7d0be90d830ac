# SPDX-License-Identifier: Apache-2.0
"""The closed loop with the virtual robot, which moves with its own error."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from arm_correction.config import CorrectConfig
from arm_correction.first import First
from arm_correction.reference import capture_reference
from benchmarks.closed_loop import close_loop, leftover
from tof_core import se3
from tof_core.capture import View
from tof_core.config import from_mapping
from tof_preproc.config import PreprocConfig
from tof_preproc.preprocessor import accumulate_views
from tof_scene.builtin import make_builtin
from tof_virtual.config import VirtualConfig
from tof_virtual.live import VirtualRobot
from tof_virtual.robot import HAND_OF_CAMERA
from toftwin.commands.simulate import bodies_of


def test_a_base_that_returns_decimetres_off_gets_the_reference_view_again() -> None:
    settings = {
        "robot": {"base_min_mm": 40.0, "base_max_mm": 50.0, "base_deg": 3.0},
        "plan": {"views": 1, "stations": 1},
        "camera": {"width": 160, "height": 122},
        "seed": 4,
    }
    robot = VirtualRobot(bodies_of(make_builtin("body_section")), from_mapping(VirtualConfig, settings))
    config = CorrectConfig()

    def look() -> View:
        return list(accumulate_views([robot.capture() for _ in range(6)], PreprocConfig()))[-1]

    first, hand = robot.T_cell_camera_true, robot.T_body_hand
    first_picture = First.of(capture_reference(look(), config.weights), config)
    robot.drive(robot.T_cell_body)
    robot.goto(hand)
    assert leftover(first, robot.T_cell_camera_true)[0] > 15
    ended = close_loop(robot, look, first_picture, config, HAND_OF_CAMERA)
    mm, deg = leftover(first, robot.T_cell_camera_true)
    assert ended.done, ended.reason
    assert ended.moves <= 3
    assert mm < 1.0
    assert deg < 0.1


def test_a_refusal_moves_nothing() -> None:
    settings = {"plan": {"views": 1, "stations": 1}, "camera": {"width": 160, "height": 122}, "seed": 4}
    robot = VirtualRobot(bodies_of(make_builtin("pipework")), from_mapping(VirtualConfig, settings))
    config = CorrectConfig()

    def look() -> View:
        return View.of_capture(robot.capture())

    first_picture = First.of(capture_reference(look(), config.weights), config)
    before = robot.T_cell_camera_true
    robot.goto(robot.T_body_hand @ se3.exp([0, 0.03, 0, 0, 0, 0]))
    here = robot.T_cell_camera_true
    tight = replace(config, limits=replace(config.limits, step_mm=5.0))
    ended = close_loop(robot, look, first_picture, tight, HAND_OF_CAMERA)
    assert not ended.done
    assert "step limit" in ended.reason
    assert ended.moves == 0
    np.testing.assert_array_equal(robot.T_cell_camera_true, here)
    assert leftover(before, here)[0] > 20
