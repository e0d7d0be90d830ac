# SPDX-License-Identifier: Apache-2.0
"""Which ROS 2 is used, the sourced Jazzy or pip's, and the interface packages that pip has not."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from progress import SetUpError

if TYPE_CHECKING:
    from progress import Steps

HERE = Path(__file__).resolve().parent
MESSAGES = "rclpy, tf2_msgs.msg, sensor_msgs.msg, geometry_msgs.msg, diagnostic_msgs.msg, std_srvs.srv"


def source() -> str:
    """`sourced` where a ROS 2 Jazzy is, else `pip`; another distribution is refused, its rclpy would be found first."""
    distribution = os.environ.get("ROS_DISTRO", "")
    if not distribution or "AMENT_PREFIX_PATH" not in os.environ:
        return "pip"
    if distribution != "jazzy":
        raise SetUpError(f"ROS {distribution} is sourced here and toftwin needs Jazzy or none; run make in a shell where it is not sourced")
    if not imports(Path(sys.executable), MESSAGES):
        raise SetUpError(
            f"ROS Jazzy is sourced, but {sys.executable} cannot import its {MESSAGES}; type: "
            "sudo apt-get install ros-jazzy-rclpy ros-jazzy-common-interfaces ros-jazzy-tf2-msgs (or run make where it is not sourced)"
        )
    return "sourced"


def imports(python: Path, modules: str) -> bool:
    """Whether an interpreter can import all of these."""
    return subprocess.run([str(python), "-c", f"import {modules}"], check=False, capture_output=True).returncode == 0


def ensure_interfaces(steps: Steps, python: Path, ros_source: str) -> None:
    """Build tf2_msgs and toftwin_msgs beside pip's ROS, then send one /tf message to ourselves.

    A sourced ROS has tf2_msgs; toftwin_msgs is built there by colcon (ros_ws/README.md), and until then nodes run without typed topics and
    actions and say so.
    """
    if ros_source == "sourced":
        steps.note("tf2_msgs from the sourced ROS 2 Jazzy; toftwin_msgs by colcon (ros_ws/README.md)")
    else:
        steps.run([str(python), str(HERE / "build_interfaces.py")])
    steps.run([str(python), str(HERE / "check_tf.py")])
