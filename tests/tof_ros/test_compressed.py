# SPDX-License-Identifier: Apache-2.0
"""A camera that publishes compressedDepth alone: heard live by the name of its topic, with the depth of the raw one."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from tof_core.camera import Camera
from tof_core.decode import pixels, stamp_ns

pytest.importorskip("rclpy", reason="no ROS 2 here")
from tests.tof_core import packing
from tests.tof_ros.peers import wait_for

if TYPE_CHECKING:
    from collections.abc import Iterator

pytestmark = pytest.mark.dds
CAMERA = Camera(32, 24, 30.0, 30.0, 15.5, 11.5, frame_id="hand_depth_sensor")
TOPIC = "/spot/depth/hand/image/compressedDepth"


@pytest.fixture(scope="module")
def context(ros_domain: int) -> Iterator[Any]:
    from tof_ros.environment import ros_context

    with ros_context(domain=ros_domain) as context:
        yield context


def test_compressed_depth_is_heard_and_one_that_is_damaged_costs_its_frame(context: Any) -> None:
    import rclpy
    from sensor_msgs.msg import CameraInfo, CompressedImage, Image, TimeReference

    from tof_preproc.node import make_node
    from tof_ros import messages, qos
    from tof_ros.environment import parameter_overrides
    from tof_ros.spin import spinning

    values = {"live.need_tf": False, "live.reliable": True, "input.depth_topic": TOPIC}
    node, peer = make_node(context=context, parameter_overrides=parameter_overrides(values)), rclpy.create_node("peer", context=context)
    depth: list[Any] = []
    done: list[Any] = []
    peer.create_subscription(Image, "preproc/depth", depth.append, qos.OUTPUT)
    peer.create_subscription(TimeReference, "preproc/done", done.append, qos.OUTPUT)
    out = peer.create_publisher(CompressedImage, TOPIC, qos.sensor(reliable=True))
    info = peer.create_publisher(CameraInfo, "/spot/depth/hand/camera_info", qos.sensor(reliable=True))
    counts = np.full(CAMERA.shape, 900, np.uint16)
    with spinning([node, peer]):
        wait_for(lambda: out.get_subscription_count() and info.get_subscription_count() and peer.count_publishers("preproc/done"))
        for number, data in enumerate((packing.depth(counts, kind="rvl"), packing.depth(counts + 1)[:60], packing.depth(counts + 1))):
            head = messages.header(1_000_000_000 + number * 66_000_000, CAMERA.frame_id)
            kind = "rvl" if number == 0 else "png"
            info.publish(messages.camera_info(CAMERA, head))
            out.publish(CompressedImage(header=head, format=f"16UC1; compressedDepth {kind}", data=messages.buffer(data)))
        wait_for(lambda: len(done) == 3)
    fates = {stamp_ns(m): m.source for m in done}
    assert [fates[s] for s in sorted(fates)] == ["kept", "bad decode", "kept"]
    assert pixels(depth[0])[12, 16] == np.float32(0.9)
