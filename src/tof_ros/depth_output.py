# SPDX-License-Identifier: Apache-2.0
"""A depth image as a node publishes it: raw, and beside it as image_transport's compressedDepth."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from sensor_msgs.msg import CompressedImage

from tof_core.compressed import DEPTH_TRANSPORT, packed_depth
from tof_ros import messages

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray
    from rclpy.publisher import Publisher
    from std_msgs.msg import Header

    from tof_ros.base import RoomNode


class DepthOutput:
    """Two publishers of one image; each message is made only while somebody is subscribed to it."""

    def __init__(self, node: RoomNode[Any], name: str, raw: Publisher, code: Callable[[], str]) -> None:
        """`raw` publishes `<room>/<name>`; `code` says how the other is compressed (png or rvl)."""
        self._node, self._raw, self._code = node, raw, code
        self._packed = node.output(f"{name}/{DEPTH_TRANSPORT}", CompressedImage)
        packed_depth(np.ones((1, 1), np.float32), code())  # RVL's kernel is loaded before frames arrive, not while they wait

    @property
    def heard(self) -> bool:
        """Whether anybody is subscribed to either."""
        return bool(self._raw.get_subscription_count() or self._packed.get_subscription_count())

    def offer(self, depth: NDArray[np.float32], head: Header) -> None:
        """Publish metres (H, W) along z, NaN where there is none."""
        self._node.offer(self._raw, lambda: messages.image(depth, "32FC1", head))
        self._node.offer(self._packed, lambda: messages.packed_depth(depth, head, self._code()))
