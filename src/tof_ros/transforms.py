# SPDX-License-Identifier: Apache-2.0
"""`/tf` and `/tf_static` into a `tof_core` transform buffer."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from tf2_msgs.msg import TFMessage

from tof_core.errors import TransformError
from tof_ros import qos

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.node import Node

    from tof_core.tf import TransformBuffer


class TransformListener:
    """Feeds a buffer; calls `on_change` after each message so that waiting frames can be tried again."""

    def __init__(self, node: Node, buffer: TransformBuffer, on_change: Callable[[], None] = lambda: None) -> None:
        """Subscribe as tf2 does: `/tf` reliable and volatile, `/tf_static` latched, 100 deep."""
        self._buffer, self._on_change, self._log = buffer, on_change, node.get_logger()
        self._heard = float("-inf")
        self.messages = self.refused = 0
        node.create_subscription(TFMessage, "/tf", lambda m: self._add(m, static=False), qos.TF)
        node.create_subscription(TFMessage, "/tf_static", lambda m: self._add(m, static=True), qos.TF_STATIC)

    @property
    def age(self) -> float:
        """Seconds since the last `/tf` message, infinite before the first."""
        return time.monotonic() - self._heard

    def _add(self, message: TFMessage, *, static: bool) -> None:
        try:
            self._buffer.add_message(message, static=static)
        except TransformError as error:
            self._refuse(str(error))
        self.messages += 1
        if not static:
            self._heard = time.monotonic()
        self._on_change()

    def _refuse(self, why: str) -> None:
        if not self.refused:
            self._log.error(f"transform refused: {why}")
        self.refused += 1
