#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Find a Python that can run toftwin and hand over to set_up.py. Usage: scripts/set_up.sh run|dev
set -eu
here=$(dirname "$0")

usable() { "$1" -c 'import sys; sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 12))' 2>/dev/null; }

# Where ROS 2 Jazzy is sourced, only the interpreter that it was built for can import its rclpy.
candidates="${PYTHON:-} python3.11 python3.12 python3 /usr/bin/python3"
if [ "${ROS_DISTRO:-}" = jazzy ]; then
    candidates="${PYTHON:-} /usr/bin/python3 python3 python3.12"
fi

for python in $candidates; do
    if usable "$python"; then
        exec "$python" -u "$here/set_up.py" "$@"
    fi
done
echo "set-up: no Python 3.11 or 3.12 found; install one (Debian, Ubuntu: apt-get install python3 python3-venv) or say PYTHON=/its/path make ${MAKECMDGOALS:-demo}" >&2
exit 1
