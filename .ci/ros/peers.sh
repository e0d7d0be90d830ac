#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Jazzy's graph from pip beside peers of another distribution: their recorder hears the graph, their life cycle tool drives it.
set -eu
cd "$(dirname "$0")/../.."
distribution=$1
apt-get install -y -q --no-install-recommends "ros-$distribution-ros2lifecycle" "ros-$distribution-rosbag2-storage-mcap"
# The image's entry point has sourced its own distribution, whose Python packages the graph must not find.
clean() { env -u ROS_DISTRO -u AMENT_PREFIX_PATH -u PYTHONPATH -u LD_LIBRARY_PATH "$@"; }
clean make setup
export ROS_DOMAIN_ID=42
clean .venv/bin/toftwin simulate --scene body_section --out out/peers --views 4
clean .venv/bin/toftwin node preproc infer --param infer.live.autostart=false &
graph=$!
. "/opt/ros/$distribution/setup.sh"
sleep 20
ros2 lifecycle set /infer configure
ros2 lifecycle set /infer activate
ros2 bag record -s mcap -o out/heard /preproc/depth /infer/depth &
recorder=$!
sleep 5
ros2 bag play out/peers
sleep 5
kill -INT "$recorder" "$graph"
wait "$recorder" || true
ros2 bag info out/heard | grep -E "Topic: /preproc/depth .* Count: [1-9]"
ros2 bag info out/heard | grep -E "Topic: /infer/depth .* Count: [1-9]"
