# SPDX-License-Identifier: Apache-2.0
"""A node of rclpy with one subscription and nothing of ours: how long after a kill -9 its successor hears the camera again."""

from __future__ import annotations

import os
import subprocess
import sys
import time

TOPIC = "/depth/hand/image"
CODE = f"""
import rclpy
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import Image

rclpy.init()
node = rclpy.create_node("plain")
heard = []
node.create_subscription(Image, "{TOPIC}", heard.append, qos_profile_sensor_data)
while not heard:
    rclpy.spin_once(node, timeout_sec=1.0)
print("heard", flush=True)
while True:
    rclpy.spin_once(node)
"""


def started(domain: int) -> subprocess.Popen[str]:
    """The node in a process of its own, which has heard a frame."""
    environment = {**os.environ, "ROS_DOMAIN_ID": str(domain)}
    process = subprocess.Popen([sys.executable, "-c", CODE], env=environment, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    process.stdout.readline()
    return process


def back_after_s(domain: int, times: int, respawn_s: float) -> list[float]:
    """Seconds from each kill until the successor, started `respawn_s` later, has heard a frame."""
    process, out = started(domain), []
    for _ in range(times):
        time.sleep(1.0)
        began = time.monotonic()
        process.kill()
        process.wait()
        time.sleep(respawn_s)
        process = started(domain)
        out.append(time.monotonic() - began)
    process.kill()
    process.wait()
    return out
