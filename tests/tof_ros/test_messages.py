# SPDX-License-Identifier: Apache-2.0
"""Arrays to messages and back: no list, no copy that is not needed, the same pose."""

from __future__ import annotations

from array import array

import numpy as np
import pytest

from tof_core import decode, se3
from tof_core.decode import pixels

pytest.importorskip("rclpy", reason="no ROS 2 here")


def test_an_image_is_one_buffer_out_and_no_copy_in() -> None:
    """A list of bytes would take rclpy a hundred times as long (rclpy #763)."""
    from tof_ros import messages

    depth = np.linspace(0.3, 2.0, 300 * 400, dtype=np.float32).reshape(300, 400)
    message = messages.image(depth, "32FC1", messages.header(5, "camera"))
    assert isinstance(message.data, array)
    assert (message.data.typecode, len(message.data), message.step) == ("B", depth.nbytes, 1600)
    read = pixels(message)
    np.testing.assert_array_equal(read, depth)
    assert np.shares_memory(read, np.frombuffer(message.data, np.uint8))


def test_a_pose_comes_back() -> None:
    from tof_ros import messages

    T = se3.exp([0.3, -0.2, 0.9, 0.4, -1.0, 0.2])
    cov = np.diag([1.0, 2.0, 3.0, 4.0, 5.0, 6.0])
    message = messages.pose(T, cov, messages.header(7, "cell"))
    np.testing.assert_allclose(messages.matrix(message.pose.pose), T, atol=1e-12)
    np.testing.assert_array_equal(message.pose.covariance.reshape(6, 6), cov)
    assert (decode.stamp_ns(message), message.header.frame_id) == (7, "cell")
    np.testing.assert_allclose(messages.matrix(messages.pose_stamped(T, message.header).pose), T, atol=1e-12)
