# SPDX-License-Identifier: Apache-2.0
"""`/tf` and `/tf_static` into a `tof_core` transform buffer, in a thread of their own."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

import rclpy
from tf2_msgs.msg import TFMessage

from tof_core.errors import TransformError
from tof_ros import messages, qos
from tof_ros.patience import NEVER
from tof_ros.spin import Spinner

if TYPE_CHECKING:
    from collections.abc import Callable

    from tof_core.tf import TransformBuffer
    from tof_ros.base import RoomNode

REST_S = 0.02
"""Pause between two looks at `/tf`, which then takes all that came: at 75 messages a second a wait for each cost as much as a filter. Ten times
the rate would still not fill the queue."""


class TransformListener:
    """Feeds a buffer, and wakes its node once TF reaches what waits there.

    It listens as a small node of its own (`<name>_tf`): a queue of 100 holds two seconds of TF at 50 Hz, and a node
    that labels for longer would lose what its frames need.
    """

    def __init__(self, node: RoomNode[Any], buffer: TransformBuffer, on_change: Callable[[], None], awaited: Callable[[], int]) -> None:
        """Subscribe as tf2 does: `/tf` reliable and volatile, `/tf_static` latched, 100 deep.

        `on_change` runs in the node's thread; `awaited`, which runs in another, is the stamp that TF must have reached to be of use.
        """
        self._node, self._buffer, self._log, self._awaited = node, buffer, node.get_logger(), awaited
        self._wake = node.create_guard_condition(on_change)
        self._heard = float("-inf")
        self.messages = self.refused = 0
        # Names as the node has them: a renaming of the node (`__node`) must not rename its helper to the same.
        ears = rclpy.create_node(
            f"{node.get_name()}_tf",
            namespace=node.get_namespace(),
            context=node.context,
            use_global_arguments=False,
            start_parameter_services=False,
        )
        topics = (node.resolve_topic_name("/tf"), node.resolve_topic_name("/tf_static"))
        ears.create_subscription(TFMessage, topics[0], lambda m: self._add(m, static=False), qos.TF)
        ears.create_subscription(TFMessage, topics[1], lambda m: self._add(m, static=True), qos.TF_STATIC)
        self._spinner = Spinner(ears, REST_S)
        node.helpers.append(self._spinner)

    @property
    def age(self) -> float:
        """Seconds since the last `/tf` message, infinite before the first."""
        return time.monotonic() - self._heard

    def close(self) -> None:
        """Listen no more."""
        self._node.helpers.remove(self._spinner)
        self._spinner.stop()
        self._node.destroy_guard_condition(self._wake)

    def _add(self, message: TFMessage, *, static: bool) -> None:
        if not static and any(self._node.left_over(messages.to_ns(t.header.stamp)) for t in message.transforms):
            return
        try:
            self._buffer.add_message(message, static=static)
        except TransformError as error:
            self._refuse(str(error))
        self.messages += 1
        if not static:
            self._heard = time.monotonic()
        reached = max((messages.to_ns(t.header.stamp) for t in message.transforms), default=NEVER)
        if static or reached >= self._awaited():
            self._wake.trigger()

    def _refuse(self, why: str) -> None:
        if not self.refused:
            self._log.error(f"transform refused: {why}")
        self.refused += 1
