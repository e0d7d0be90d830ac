# SPDX-License-Identifier: Apache-2.0
"""A node `preproc` with a camera before it and an observer behind it."""

from __future__ import annotations

import time
from collections import defaultdict
from typing import TYPE_CHECKING, Any

import numpy as np

from tof_core.camera import Camera
from tof_core.decode import stamp_ns

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.node import Node

CAMERA = Camera(32, 24, 30.0, 30.0, 15.5, 11.5, frame_id="hand_depth_sensor")
RATE_NS = 66_000_000


class Bench:
    """A `preproc` in one thread, a camera and an observer in another."""

    def __init__(self, node: Any, peer: Node) -> None:
        from diagnostic_msgs.msg import DiagnosticArray
        from sensor_msgs.msg import CameraInfo, Image

        from tof_preproc.node import OUTPUTS
        from tof_ros import qos
        from tof_ros.interfaces import own_message

        self.node, self.peer = node, peer
        self.heard: dict[str, list[Any]] = defaultdict(list)
        self._depth = peer.create_publisher(Image, "spot/depth/hand/image", qos.sensor(reliable=True))
        self._info = peer.create_publisher(CameraInfo, "spot/depth/hand/camera_info", qos.sensor(reliable=True))
        from sensor_msgs.msg import TimeReference

        for name, kind in {**OUTPUTS, "done": TimeReference}.items():
            peer.create_subscription(kind, f"spot/preproc/{name}", self.heard[name].append, qos.OUTPUT)
        if (dwell := own_message("Dwell")) is not None:
            peer.create_subscription(dwell, "spot/preproc/dwell_info", self.heard["dwell_info"].append, qos.OUTPUT)
        peer.create_subscription(DiagnosticArray, "/diagnostics", self.heard["diagnostics"].append, qos.OUTPUT)
        wait_for(
            lambda: (
                self._depth.get_subscription_count() and self._info.get_subscription_count() and peer.count_publishers("spot/preproc/done")
            )
        )
        time.sleep(0.3)

    def send(self, number: int, metres: float = 0.8, *, fx: float = 30.0) -> int:
        """Publish frame `number` as 16UC1 and its camera_info; gives its stamp."""
        from tof_ros import messages

        stamp = 1_000_000_000 + number * RATE_NS
        head = messages.header(stamp, CAMERA.frame_id)
        counts = np.full(CAMERA.shape, round(metres * 1000), np.uint16)
        counts[0, :3] = 0, 65535, number % 7 + 500
        info = messages.camera_info(CAMERA, head)
        info.k[0] = fx
        self._info.publish(info)
        self._depth.publish(messages.image(counts, "16UC1", head))
        return stamp

    def outputs(self, stamp: int) -> dict[str, Any]:
        """What was published for a frame, once all of it has come."""

        def found() -> dict[str, Any]:
            return {name: m for name, ms in self.heard.items() if name != "diagnostics" for m in ms if stamp_ns(m) == stamp}

        wait_for(lambda: {"depth", "sigma", "count", "reason", "camera_info", "points", "dwell", "done"} <= found().keys())
        return found()

    def call(self, service: str) -> Any:
        """Call a service of the node."""
        from std_srvs.srv import Trigger

        client = self.peer.create_client(Trigger, f"spot/preproc/{service}")
        assert client.wait_for_service(5.0)
        return client.call(Trigger.Request(), timeout_sec=5.0)


def wait_for(condition: Callable[[], Any], seconds: float = 20.0) -> None:
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, "timed out"
        time.sleep(0.01)
