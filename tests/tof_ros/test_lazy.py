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


@pytest.mark.dds
@pytest.mark.parametrize("code", ["png", "rvl"])
def test_compressed_depth_is_made_for_its_subscriber_and_is_the_depth(ros_domain: int, code: str) -> None:
    from sensor_msgs.msg import CameraInfo, CompressedImage, Image

    from tof_core.decode import decode_depth
    from tof_preproc.node import make_node
    from tof_ros import messages, qos
    from tof_ros.environment import parameter_overrides, ros_context
    from tof_ros.spin import spinning

    with ros_context(domain=ros_domain) as context:
        values = {"live.need_tf": False, "live.reliable": True, "live.depth_code": code}
        node = make_node(context=context, parameter_overrides=parameter_overrides(values))
        observer = Observer(context)
        packed: list[Any] = []
        unfiltered: list[Any] = []
        observer.node.create_subscription(CompressedImage, "preproc/depth/compressedDepth", packed.append, qos.OUTPUT)
        observer.node.create_subscription(Image, "preproc/unfiltered_depth", unfiltered.append, qos.OUTPUT)
        depth = observer.node.create_publisher(Image, "depth/hand/image", qos.sensor(reliable=True))
        info = observer.node.create_publisher(CameraInfo, "depth/hand/camera_info", qos.sensor(reliable=True))
        head = messages.header(1_000_000_000, CAMERA.frame_id)
        counts = np.full(CAMERA.shape, 900, np.uint16)
        counts[12, 15] = 1500  # one pixel that statistics remove
        with spinning([node, observer.node]):
            wait_for(lambda: depth.get_subscription_count() and info.get_subscription_count())
            wait_for(lambda: node._outputs["unfiltered_depth"].get_subscription_count() and node._depth._packed.get_subscription_count())
            info.publish(messages.camera_info(CAMERA, head))
            depth.publish(messages.image(counts, "16UC1", head))
            wait_for(lambda: packed and unfiltered)
    assert packed[0].format == f"32FC1; compressedDepth {code}"
    metres, _ = decode_depth(packed[0], "preproc/depth/compressedDepth")
    raw, _ = decode_depth(unfiltered[0], "preproc/unfiltered_depth")
    assert metres[5, 5] == pytest.approx(0.9, abs=1e-4)
    assert np.isnan(metres[12, 15])
    assert raw[12, 15] == pytest.approx(1.5)
