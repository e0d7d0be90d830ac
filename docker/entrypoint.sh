#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Source what there is (ROS, the workspace), put toftwin on the path, run the command.
set -e
for setup in /opt/ros/jazzy/setup.sh /opt/toftwin/ros_ws/install/local_setup.sh; do
    if [ -f "$setup" ]; then
        . "$setup"
    fi
done
PATH=/opt/toftwin/.venv/bin:$PATH
export PATH
exec "$@"
