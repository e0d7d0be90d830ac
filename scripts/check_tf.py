# SPDX-License-Identifier: Apache-2.0
"""Publish one /tf message and receive it back over DDS, on this host only, and try the executor: the proof that nodes will run."""

from __future__ import annotations

import os
import sys
import time


def main() -> int:
    """Return 0 when the message came back within 20 seconds."""
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    import rclpy
    from geometry_msgs.msg import TransformStamped
    from tf2_msgs.msg import TFMessage

    received: list[str] = []
    rclpy.init()
    node = rclpy.create_node("toftwin_setup_check")
    node.create_subscription(TFMessage, "toftwin_setup_check", lambda m: received.append(m.transforms[0].child_frame_id), 1)
    publisher = node.create_publisher(TFMessage, "toftwin_setup_check", 1)
    deadline = time.monotonic() + 20.0
    while not received and time.monotonic() < deadline:
        publisher.publish(TFMessage(transforms=[TransformStamped(child_frame_id="camera")]))
        rclpy.spin_once(node, timeout_sec=0.1)
    node.destroy_node()
    rclpy.shutdown()
    if received != ["camera"]:
        sys.stderr.write("no /tf message came back over DDS in 20 s: is UDP on the loopback device blocked?\n")
        return 1
    return check_executors()


def check_executors() -> int:
    """Return 0 when at least rclpy's own executor runs all that a node has; one that must stand in is said."""
    from tof_ros.environment import rclpy_version
    from tof_ros.trial import try_here

    (own, why), (fallback, nothing_works) = try_here().items()
    if why:
        sys.stderr.write(f"{own} does not work with rclpy {rclpy_version()}: {why}\n")
    if why and nothing_works:
        sys.stderr.write(f"{fallback} does not either: {nothing_works}\n")
    return int(bool(why and nothing_works))


if __name__ == "__main__":
    sys.exit(main())
