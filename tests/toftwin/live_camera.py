# SPDX-License-Identifier: Apache-2.0
"""A depth camera that publishes over DDS for the tests: images best-effort, TF as tf2 does."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING

import numpy as np

from tof_core.encode import depth_counts

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from tof_core.arrays import Image
    from tof_core.camera import Camera


@contextmanager
def live_camera(camera: Camera, depth_of: Callable[[int], Image], *, with_info: bool = True) -> Iterator[None]:
    """Publish at 15 Hz, TF at 50 Hz, while the block runs; CameraInfo is advertised, and sent if the camera is `with_info`."""
    import rclpy
    from sensor_msgs.msg import CameraInfo
    from sensor_msgs.msg import Image as ImageMessage
    from tf2_msgs.msg import TFMessage

    from tof_ros import messages, qos
    from tof_ros.environment import ros_context
    from tof_ros.spin import spinning

    with ros_context() as context:
        node = rclpy.create_node("camera", context=context)
        image = node.create_publisher(ImageMessage, "depth/hand/image", qos.sensor())
        info = node.create_publisher(CameraInfo, "depth/hand/camera_info", qos.sensor())
        tf, tf_static = node.create_publisher(TFMessage, "/tf", qos.TF), node.create_publisher(TFMessage, "/tf_static", qos.TF_STATIC)
        tf_static.publish(TFMessage(transforms=[messages.transform("body", camera.frame_id, np.eye(4))]))
        count = iter(range(10**6))

        def shoot() -> None:
            head = messages.header(node.get_clock().now().nanoseconds, camera.frame_id)
            if with_info:
                info.publish(messages.camera_info(camera, head))
            image.publish(messages.image(depth_counts(depth_of(next(count))), "16UC1", head))

        def place() -> None:
            tf.publish(TFMessage(transforms=[messages.transform("cell", "body", np.eye(4), node.get_clock().now().nanoseconds)]))

        node.create_timer(1 / 15, shoot)
        node.create_timer(0.02, place)
        with spinning([node]):
            yield
