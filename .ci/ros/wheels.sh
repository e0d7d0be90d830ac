#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# The graph on the newest rclpy that is a wheel (Kilted's): its tests in an environment of their own, which takes all but ROS from `.venv`.
set -eu
cd "$(dirname "$0")/../.."
make setup-dev
.venv/bin/python -m venv out/kilted
out/kilted/bin/pip install -q -r .ci/ros/kilted.txt
out/kilted/bin/python scripts/build_interfaces.py
libraries=$(.venv/bin/python -c 'import sysconfig; print(sysconfig.get_path("purelib"))')
# Behind its own packages, so that of ROS nothing is Jazzy's.
echo "$libraries" > "$(out/kilted/bin/python -c 'import sysconfig; print(sysconfig.get_path("purelib"))')/zz_behind.pth"
export PYTHONPATH=src
out/kilted/bin/python -m toftwin.cli doctor
out/kilted/bin/python -m pytest -q -p no:cacheprovider tests/tof_ros tests/tof_preproc/test_node.py tests/tof_infer/test_node.py \
    tests/tof_inspect/test_node.py tests/arm_correction/test_node.py tests/tof_gap/test_node.py tests/tof_gap/test_node_diagnose.py \
    tests/tof_sensor/test_node.py tests/toftwin/test_graph.py
