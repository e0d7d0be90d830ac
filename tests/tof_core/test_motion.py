# SPDX-License-Identifier: Apache-2.0
"""Stations from the body's pose, the motion gate from the camera's."""

from __future__ import annotations

import numpy as np
import pytest

from tof_core import se3
from tof_core.motion import MotionConfig, StationConfig, StationTracker, camera_motion, camera_velocity, is_still
from tof_core.tf import TransformBuffer

MS = 1_000_000


def test_a_station_lasts_while_the_base_stands() -> None:
    tracker = StationTracker(StationConfig(tolerance_mm=8.0, tolerance_deg=0.5))
    stops: list[list[float]] = [
        [0, 0, 0, 0, 0, 0],
        [0.005, 0, 0, 0, 0, 0],
        [0, 0, 0, 0, 0, 0.005],
        [0.4, 0, 0, 0, 0, 0],
        [0.405, 0, 0, 0, 0, 0],
        [0.4, 0, 0, 0, 0, 0.02],
        [0, 0, 0, 0, 0, 0],
    ]
    assert [tracker.push(se3.exp(x)) for x in stops] == [0, 0, 0, 1, 1, 2, 3]


def test_a_slow_drift_does_not_carry_a_station_away() -> None:
    tracker = StationTracker(StationConfig(tolerance_mm=8.0))
    stations = [tracker.push(se3.exp([0.001 * i, 0, 0, 0, 0, 0])) for i in range(20)]
    assert stations[:9] == [0] * 9
    assert stations[9] == 1


def test_a_reset_begins_again() -> None:
    tracker = StationTracker()
    tracker.push(np.eye(4))
    tracker.push(se3.exp([1, 0, 0, 0, 0, 0]))
    tracker.reset()
    assert tracker.push(se3.exp([5, 0, 0, 0, 0, 0])) == 0


def moving(speed: float, turn: float) -> TransformBuffer:
    """A camera that moves along its x at `speed` m/s and turns at `turn` rad/s from 0 to 1 s."""
    tf = TransformBuffer()
    for ms in range(0, 1001, 20):
        tf.add("cell", "camera", ms * MS, se3.exp([0, 0, 1, 0.2, 0.3, 0]) @ se3.exp([speed * ms / 1000, 0, 0, 0, 0, turn * ms / 1000]))
    return tf


def test_the_velocity_is_the_camera_s_own() -> None:
    velocity = camera_velocity(moving(0.2, 0.1), "cell", "camera", 500 * MS, 0.04)
    assert velocity is not None
    np.testing.assert_allclose(velocity, [0.2, 0, 0, 0, 0, 0.1], atol=1e-6)


@pytest.mark.parametrize(
    ("speed", "turn", "still"),
    [
        (0.0, 0.0, True),
        (0.009, 0.0, True),
        (0.011, 0.0, False),
        (0.0, np.radians(0.9), True),
        (0.0, np.radians(1.1), False),
    ],
)
def test_the_gate_opens_below_both_bounds(speed: float, turn: float, still: bool) -> None:  # noqa: FBT001
    config = MotionConfig(speed_mm_s=10.0, turn_deg_s=1.0)
    assert is_still(moving(speed, turn), "cell", "camera", 500 * MS, config) is still


@pytest.mark.parametrize("ms", [0, 20, 980, 1000])
def test_at_either_end_of_tf_the_velocity_is_that_of_the_side_that_is_there(ms: int) -> None:
    velocity = camera_velocity(moving(0.2, 0.1), "cell", "camera", ms * MS, 0.04)
    assert velocity is not None
    np.testing.assert_allclose(velocity, [0.2, 0, 0, 0, 0, 0.1], atol=1e-6)


@pytest.mark.parametrize("ms", [0, 500, 1000])
@pytest.mark.parametrize(("speed", "still"), [(0.009, True), (0.011, False)])
def test_the_gate_is_as_sharp_at_either_end_of_tf(ms: int, speed: float, still: bool) -> None:  # noqa: FBT001
    assert is_still(moving(speed, 0.0), "cell", "camera", ms * MS, MotionConfig(speed_mm_s=10.0)) is still


def test_one_stamp_gives_no_velocity() -> None:
    tf = TransformBuffer()
    tf.add("cell", "camera", 0, np.eye(4))
    assert camera_velocity(tf, "cell", "camera", 0, 0.04) is None


@pytest.mark.parametrize(("ms", "uneven"), [(400, False), (490, True), (500, True), (510, True), (600, False)])
def test_a_camera_that_stops_at_500_ms_moves_unevenly_about_then(ms: int, uneven: bool) -> None:  # noqa: FBT001
    tf = TransformBuffer()
    for t in range(0, 1001, 20):
        tf.add("cell", "camera", t * MS, se3.exp([0.2 * min(t, 500) / 1000, 0, 0, 0, 0, 0.0]))
    assert camera_motion(tf, "cell", "camera", ms * MS, 0.04)[1] is uneven


def test_one_pose_of_tf_that_jumps_is_uneven_motion() -> None:
    tf = TransformBuffer()
    for t in range(0, 1001, 20):
        tf.add("cell", "camera", t * MS, se3.exp([0.2 * t / 1000, 0.05 if t == 540 else 0.0, 0, 0, 0, 0]))
    assert camera_motion(tf, "cell", "camera", 500 * MS, 0.04)[1]


def test_without_tf_nothing_counts_as_standing_still() -> None:
    assert not is_still(moving(0.0, 0.0), "cell", "camera", 5000 * MS)
    assert not is_still(TransformBuffer(), "cell", "camera", 0)
