# SPDX-License-Identifier: Apache-2.0
"""An image is made only while somebody is subscribed to it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from tof_core.camera import Camera

pytest.importorskip("rclpy", reason="no ROS 2 here")
from tests.tof_ros.peers import Observer, wait_for

if TYPE_CHECKING:
    from numpy.typing import NDArray

CAMERA = Camera(32, 24, 30.0, 30.0, 15.5, 11.5, frame_id="hand_depth_sensor")


@pytest.mark.dds
def test_preproc_makes_the_images_that_are_asked_for_and_no_other(ros_domain: int, monkeypatch: pytest.MonkeyPatch) -> None:
    from sensor_msgs.msg import CameraInfo, Image, TimeReference

    from tof_preproc.node import make_node
    from tof_ros import messages, qos
    from tof_ros.environment import parameter_overrides, ros_context
    from tof_ros.spin import spinning

    made: list[str] = []
    image = messages.image

    def counted(values: NDArray[Any], encoding: str, head: Any) -> Any:
        made.append(encoding)
        return image(values, encoding, head)

    with ros_context(domain=ros_domain) as context:
        node = make_node(context=context, parameter_overrides=parameter_overrides({"live.need_tf": False, "live.reliable": True}))
        observer = Observer(context)
        heard: list[Any] = []
        done: list[Any] = []
        observer.node.create_subscription(Image, "preproc/count", heard.append, qos.OUTPUT)
        observer.node.create_subscription(TimeReference, "preproc/done", done.append, qos.OUTPUT)
        depth = observer.node.create_publisher(Image, "depth/hand/image", qos.sensor(reliable=True))
        info = observer.node.create_publisher(CameraInfo, "depth/hand/camera_info", qos.sensor(reliable=True))
        head = messages.header(1_000_000_000, CAMERA.frame_id)
        raw = image(np.full(CAMERA.shape, 900, np.uint16), "16UC1", head)
        monkeypatch.setattr(messages, "image", counted)
        with spinning([node, observer.node]):
            wait_for(
                lambda: depth.get_subscription_count() and info.get_subscription_count() and observer.node.count_publishers("preproc/count")
            )
            wait_for(lambda: node._outputs["count"].get_subscription_count() and node._done.get_subscription_count())
            info.publish(messages.camera_info(CAMERA, head))
            depth.publish(raw)
            wait_for(lambda: heard and done)
    assert made == ["16UC1"]
