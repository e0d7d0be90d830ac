# SPDX-License-Identifier: Apache-2.0
"""Another day: the plan and the camera stay, errors of the robot, light and noise do not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tests.tof_virtual.made import bench, config
from tof_core import se3
from tof_virtual.calibrate import calibrate, resize
from tof_virtual.live import VirtualRobot
from tof_virtual.session import Session


def test_the_robot_believes_the_same_and_stands_elsewhere() -> None:
    days = [Session(bench(), replace(config(), day=day), {}) for day in (0, 1, 2)]
    believed = [np.stack([s.robot_pose(k) for k in s.shutters]) for s in days]
    np.testing.assert_array_equal(believed[0], believed[1])
    off = [[1e3 * se3.distance(s.true_pose(k), s.robot_pose(k))[0] for k in s.shutters] for s in days]
    assert np.all(np.abs(np.subtract(off[0], off[1])) > 0.1)
    assert np.all(np.abs(np.subtract(off[1], off[2])) > 0.1)


def test_the_first_day_is_the_session_without_days() -> None:
    one, two = (np.random.default_rng(seed).normal(size=4) for seed in ([3, 2], [3, 2, 0]))
    np.testing.assert_array_equal(one, two)


def test_the_same_camera_is_carried_to_another_day() -> None:
    first = Session(bench(), config(), {"wiggling": 1.0})
    calibrate(first)
    again = Session(bench(), replace(config(), day=1), {"wiggling": 1.0})
    resize(again, {e.name: e.size for e in first.effects})
    assert again.effects[0].size == first.effects[0].size
    assert again.effects[0].params() == first.effects[0].params()


def test_bodies_may_stand_otherwise_than_planned() -> None:
    nominal = bench()
    standing = nominal[:-1]
    whole, lacking = Session(nominal, config(), {}), Session(nominal, config(), {}, standing)
    for a, b in zip(whole.stops, lacking.stops, strict=True):
        np.testing.assert_array_equal(a.T_body_hand, b.T_body_hand)
    assert [b.name for b in lacking.bodies] == [b.name for b in standing]
    seen = [np.concatenate([s.sight(k, ()).z for k in s.shutters]) for s in (whole, lacking)]
    assert not np.array_equal(seen[0], seen[1], equal_nan=True)


def test_the_live_robot_starts_where_the_recorded_day_does() -> None:
    settings = replace(config(), day=1)
    session, robot = Session(bench(), settings, {}), VirtualRobot(bench(), settings, sizes={})
    np.testing.assert_allclose(robot.T_cell_camera_true, session.true_pose(session.shutters[0]), atol=1e-12)
