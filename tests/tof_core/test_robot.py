# SPDX-License-Identifier: Apache-2.0
"""The chain cell, body, camera: found by name, placed by the user, refused where unknown."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from tof_core import se3
from tof_core.errors import TransformError
from tof_core.placement import Placement
from tof_core.robot import RobotChain
from tof_core.tf import TransformBuffer

if TYPE_CHECKING:
    from tof_core.arrays import Float

CELL_BODY = se3.exp([1.0, 0.2, 0.5, 0.0, 0.1, 0.4])
BODY_CAMERA = se3.exp([0.4, 0.0, 0.3, 0.6, -0.1, 0.2])


def buffer(root: str = "cell", body: str = "spot/body", camera: str = "spot/camera") -> TransformBuffer:
    tf = TransformBuffer()
    for ns in (0, 100_000_000):
        tf.add(root, body, ns, CELL_BODY)
        tf.add(body, camera, ns, BODY_CAMERA)
    return tf


@pytest.mark.parametrize("body", ["body", "spot/body", "base_link", "fleet/7/base_link"])
def test_the_body_is_found_by_the_last_part_of_its_name(body: str) -> None:
    chain = RobotChain(buffer(body=body), "cell")
    assert chain.resolve("spot/camera") == ("cell", body)
    pose = chain.pose("spot/camera", 50_000_000)
    np.testing.assert_allclose(pose.T_cell_body, CELL_BODY, atol=1e-12)
    np.testing.assert_allclose(pose.T_body_camera, BODY_CAMERA, atol=1e-12)


def test_a_chain_without_a_body_is_one_station() -> None:
    pose = RobotChain(buffer(body="arm_base"), "cell").pose("spot/camera", 0)
    np.testing.assert_array_equal(pose.T_cell_body, np.eye(4))
    np.testing.assert_allclose(pose.T_cell_camera, CELL_BODY @ BODY_CAMERA, atol=1e-12)


def test_a_body_aside_of_the_chain_does_not_count() -> None:
    tf = buffer(body="arm_base")
    tf.add("cell", "other/body", 0, CELL_BODY, static=True)
    assert RobotChain(tf, "cell").resolve("spot/camera") == ("cell", "")


def test_a_body_that_the_user_names_must_be_on_the_way() -> None:
    tf = buffer(body="waist")
    assert RobotChain(tf, "cell", "waist").resolve("spot/camera") == ("cell", "waist")
    with pytest.raises(
        TransformError, match="body frame 'hips' is not between 'cell' and 'spot/camera'; between them are: cell, waist, spot/camera"
    ):
        RobotChain(tf, "cell", "hips").resolve("spot/camera")


def test_without_a_scene_the_root_is_the_cell() -> None:
    assert RobotChain(buffer(root="odom")).resolve("spot/camera") == ("odom", "spot/body")


def test_a_robot_in_odom_gets_its_cell_by_placement() -> None:
    T_odom_cell = se3.exp([2.0, 1.0, 0.0, 0.0, 0.0, 1.0])
    chain = RobotChain(buffer(root="odom"), "cell", placed=Placement("odom", T_odom_cell))
    pose = chain.pose("spot/camera", 50_000_000)
    np.testing.assert_allclose(pose.T_cell_camera, se3.inverse(T_odom_cell) @ CELL_BODY @ BODY_CAMERA, atol=1e-12)
    np.testing.assert_allclose(pose.T_body_camera, BODY_CAMERA, atol=1e-12)


@pytest.mark.parametrize("placed", [None, Placement("odom", np.eye(4))])
@pytest.mark.parametrize("cell", ["", "cell"])
def test_without_any_tf_that_is_what_is_said(cell: str, placed: Placement | None) -> None:
    with pytest.raises(TransformError, match=r"^TF: no transform has come on /tf or /tf_static; publish both"):
        RobotChain(TransformBuffer(), cell, placed=placed).resolve("spot/camera")


def test_without_a_cell_a_camera_that_tf_lacks_is_named() -> None:
    with pytest.raises(TransformError, match=r"TF does not have the camera's frame 'camera'; .*TF has cell, spot/body, spot/camera"):
        RobotChain(buffer()).resolve("camera")


def test_two_robots_are_placed_in_one_cell_which_has_one_parent() -> None:
    first, second = se3.exp([2.0, 1.0, 0.0, 0.0, 0.0, 1.0]), se3.exp([-1.0, 0.5, 0.0, 0.0, 0.0, -0.4])
    told: list[tuple[str, str, Float]] = []
    tf = buffer(root="one/odom", body="one/body", camera="one/camera")
    for ns in (0, 100_000_000):
        tf.add("two/odom", "two/body", ns, CELL_BODY)
        tf.add("two/body", "two/camera", ns, BODY_CAMERA)
    for root, T_root_cell in (("one/odom", first), ("two/odom", second)):
        chain = RobotChain(tf, "cell", placed=Placement(root, T_root_cell), on_placed=lambda a, b, T: told.append((a, b, T)))
        camera = root.replace("odom", "camera")
        pose = chain.pose(camera, 50_000_000)
        np.testing.assert_allclose(pose.T_cell_camera, se3.inverse(T_root_cell) @ CELL_BODY @ BODY_CAMERA, atol=1e-12)
    assert [(parent, child) for parent, child, _ in told] == [("one/odom", "cell"), ("cell", "two/odom")]
    np.testing.assert_allclose(told[1][2], se3.inverse(second), atol=1e-12)
    tf.add("map", "three/odom", 0, np.eye(4), static=True)
    tf.add("three/odom", "three/camera", 0, np.eye(4), static=True)
    with pytest.raises(
        TransformError, match="'cell' belongs to another robot's TF, and 'three/odom' has a parent; place the cell in 'map'"
    ):
        RobotChain(tf, "cell", placed=Placement("three/odom", first)).resolve("three/camera")


def test_without_tf_the_placement_is_that_of_the_camera() -> None:
    T_camera_cell = se3.exp([0.0, 0.0, 1.5, 0.1, 0.0, 0.0])
    pose = RobotChain(TransformBuffer(), "cell", placed=Placement("camera", T_camera_cell)).pose("camera", 123)
    np.testing.assert_allclose(pose.T_cell_camera, se3.inverse(T_camera_cell), atol=1e-12)


def test_a_cell_frame_in_tf_overrides_a_placement() -> None:
    chain = RobotChain(buffer(), "cell", placed=Placement("spot/body", np.eye(4)))
    np.testing.assert_allclose(chain.pose("spot/camera", 0).T_cell_camera, CELL_BODY @ BODY_CAMERA, atol=1e-12)


@pytest.mark.parametrize("stamp_ns", [-1, 0, 30_000_000, 50_000_000, 90_000_000, 100_000_001])
@pytest.mark.parametrize("late", ["spot/body", "spot/camera"])
def test_the_check_fails_where_the_pose_does(late: str, stamp_ns: int) -> None:
    """One of the two edges begins 50 ms after the other."""
    tf = TransformBuffer()
    for parent, child, T in (("cell", "spot/body", CELL_BODY), ("spot/body", "spot/camera", BODY_CAMERA)):
        for ns in (50_000_000 if child == late else 0, 100_000_000):
            tf.add(parent, child, ns, T)
    chain = RobotChain(tf, "cell")
    if 50_000_000 <= stamp_ns <= 100_000_000:
        chain.check("spot/camera", stamp_ns)
        chain.pose("spot/camera", stamp_ns)
        return
    for asked in (chain.check, chain.pose):
        with pytest.raises(TransformError):
            asked("spot/camera", stamp_ns)


def test_an_unknown_cell_names_the_frames_and_the_flags() -> None:
    with pytest.raises(TransformError) as caught:
        RobotChain(buffer(root="odom"), "cell").pose("spot/camera", 0)
    text = str(caught.value)
    assert "TF does not have the cell frame 'cell'" in text
    assert "--initial-pose" in text
    assert "--cell-frame" in text
    assert "odom, spot/body, spot/camera" in text


def test_a_placement_in_a_frame_that_tf_lacks_is_refused() -> None:
    with pytest.raises(TransformError, match="the cell is placed in 'vision', which TF does not connect"):
        RobotChain(buffer(root="odom"), "cell", placed=Placement("vision", np.eye(4))).pose("spot/camera", 0)


def test_a_placement_that_is_no_motion_is_refused() -> None:
    with pytest.raises(TransformError, match="placement in odom"):
        Placement("odom", 2.0 * np.eye(4))
