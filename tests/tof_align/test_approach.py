# SPDX-License-Identifier: Apache-2.0
"""From far to near: what a descent finds, and what only looking along open directions finds."""

from __future__ import annotations

import numpy as np
import pytest

from tests.tof_align.made import CONFIG, ROBOT, at, box, look, measured, one_view, scene_of, section
from tof_align.approach import approach
from tof_align.pixels import sample
from tof_core import se3
from tof_core.capture import RobotPose
from tof_scene.raycast import Raycaster


@pytest.mark.parametrize("seed", range(4))
def test_stations_are_brought_within_the_fine_stages_reach(seed: int) -> None:
    error = ROBOT * np.random.default_rng(seed).normal(size=6)
    view, truth = one_view(section(), error)
    assert view.robot is not None
    T = view.robot.T_cell_camera
    motion = approach([sample(view, CONFIG.weights).coarse], T[None], T, ROBOT, section(), CONFIG)
    metres, degrees = se3.distance(T @ motion, truth.T_cell_camera)
    assert metres < 0.004
    assert degrees < 0.4


@pytest.mark.parametrize("off", [-0.06, 0.05, 0.07])
def test_the_one_feature_of_a_wall_is_found_where_a_descent_would_not_feel_it(off: float) -> None:
    caster = Raycaster(scene_of(box("wall", (0.02, 3, 3), at(0, 0, 0.8)), box("knob", (0.03, 0.08, 0.08), at(0.02, 0, 0.8))))
    T = look(np.array([0.9, 0.05, 0.85]), np.array([0.0, 0.0, 0.8]))
    robot = at(0, off, 0.0) @ T
    view, truth = measured(caster, T, RobotPose(np.eye(4), robot))
    motion = approach([sample(view, CONFIG.weights).coarse], robot[None], robot, ROBOT, caster, CONFIG)
    found = (robot @ motion)[:3, 3] - truth.T_cell_camera[:3, 3]
    assert abs(found[1]) < 0.02  # the coarse raster has a ray every 34 mm there


def test_a_plain_wall_is_left_where_the_robot_says() -> None:
    caster = Raycaster(scene_of(box("wall", (0.02, 4, 4), at(0, 0, 0.8))))
    T = look(np.array([0.9, 0.0, 0.8]), np.array([0.0, 0.0, 0.8]))
    robot = at(0.03, 0.02, 0.01) @ T
    view, _ = measured(caster, T, RobotPose(np.eye(4), robot))
    motion = approach([sample(view, CONFIG.weights).coarse], robot[None], robot, ROBOT, caster, CONFIG)
    moved = (robot @ motion)[:3, 3] - robot[:3, 3]
    assert moved[0] == pytest.approx(-0.03, abs=0.002)
    assert np.abs(moved[1:]).max() < 0.003
