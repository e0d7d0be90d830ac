#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# The graph on the sourced Jazzy: set-up, all packages built, the tests that need ROS, the launch file as `ros2 launch` reads it.
set -eu
cd "$(dirname "$0")/../.."
. /opt/ros/jazzy/setup.sh
apt-get install -y -q --no-install-recommends ros-jazzy-ros2launch ros-jazzy-rosbag2-storage-mcap
make setup-dev
. .venv/bin/activate
(cd ros_ws && python -m colcon build)
. ros_ws/install/setup.sh
.venv/bin/toftwin doctor
.venv/bin/python -m pytest -q tests/tof_ros tests/ros_ws tests/tof_preproc tests/tof_infer/test_node.py tests/tof_inspect/test_node.py
ros2 launch toftwin_bringup graph.launch.py --show-args
