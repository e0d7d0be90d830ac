# SPDX-License-Identifier: Apache-2.0
"""`toftwin node --auto` hears the only camera that is published; where there are two it names them and the flag."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

from tof_core.errors import TopicError
from tof_core.topics import Topics
from toftwin import auto

pytest.importorskip("rclpy", reason="no ROS 2 here")
if TYPE_CHECKING:
    from collections.abc import Iterator


@pytest.fixture
def robot(ros_domain: int) -> Iterator[Any]:
    """A node that publishes what a test asks for."""
    import rclpy

    from tof_ros.environment import ros_context

    with ros_context(domain=ros_domain) as context:
        node = rclpy.create_node("driver", context=context)
        yield node
        node.destroy_node()


def publish(node: Any, *cameras: str) -> None:
    from sensor_msgs.msg import CameraInfo, Image

    for camera in cameras:
        node.create_publisher(Image, f"{camera}/image_rect_raw", 1)
        node.create_publisher(CameraInfo, f"{camera}/camera_info", 1)


@pytest.mark.dds
def test_the_only_camera_is_taken_whatever_it_is_called(robot: Any) -> None:
    publish(robot, "/cam1/depth")
    topics = auto.find_live(10.0)
    assert (topics.depth, topics.info) == ("/cam1/depth/image_rect_raw", "/cam1/depth/camera_info")
    assert auto.taken(topics) == "auto: /cam1/depth/image_rect_raw, /cam1/depth/camera_info"


@pytest.mark.dds
def test_two_cameras_are_named_with_the_flag_that_chooses(robot: Any) -> None:
    publish(robot, "/cam1/depth", "/cam2/depth")
    with pytest.raises(TopicError) as refused:
        auto.find_live(3.0)
    line = str(refused.value)
    assert "has 2 topics that may be the depth image" in line
    assert "--param preproc.input.depth_topic=TOPIC with one of: /cam1/depth/image_rect_raw, /cam2/depth/image_rect_raw" in line


@pytest.mark.dds
def test_where_nothing_is_published_the_domain_and_the_reach_are_named(robot: Any) -> None:
    with pytest.raises(TopicError, match=r"--auto: has no depth image and no point cloud \(domain \d+, this host alone\)"):
        auto.find_live(0.5)


def test_what_the_user_names_wins_and_each_node_gets_its_own() -> None:
    topics = Topics(depth="/a/depth", info="/a/camera_info", colour="/a/rgb", colour_info="/a/rgb_info")
    given = {"preproc": {"input.info_topic": "/mine"}, "sim_label": {}, "inspect": {}}
    assert auto.with_topics(given, topics, list(given)) == {
        "preproc": {"input.depth_topic": "/a/depth", "input.info_topic": "/mine"},
        "sim_label": {},
        "inspect": {"live.colour_topic": "/a/rgb", "live.colour_info_topic": "/a/rgb_info"},
    }
