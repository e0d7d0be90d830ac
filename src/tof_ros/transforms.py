# SPDX-License-Identifier: Apache-2.0
"""`/tf` and `/tf_static` into a `tof_core` transform buffer, in a thread of their own."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

import rclpy
from tf2_msgs.msg import TFMessage

from tof_core.errors import TransformError
from tof_core.tf_message import read_transforms
from tof_ros import qos
from tof_ros.patience import ALWAYS, NEVER
from tof_ros.spin import Spinner

if TYPE_CHECKING:
    from collections.abc import Callable

    from tof_core.tf import TransformBuffer
    from tof_ros.base import RoomNode

REST_S = 0.04
"""Pause between two looks at `/tf`, which then takes all that came: at 75 messages a second a wait for each cost as much as a filter, a look
0.2 ms. A frame waits for transforms 40 ms after its stamp anyway; 2500 messages a second would fill the queue."""
IDLE_REST_S = 0.1
"""The same while nothing waits for TF, for a node to which that matters little: 1000 messages a second would fill the queue."""


class TransformListener:
    """Feeds a buffer, and wakes its node once TF reaches what waits there.

    It listens as a small node of its own (`<name>_tf`): a queue of 100 holds two seconds of TF at 50 Hz, and a node
    that labels for longer would lose what its frames need.
    """

    def __init__(
        self,
        node: RoomNode[Any],
        buffer: TransformBuffer,
        on_change: Callable[[], None],
        awaited: Callable[[], int],
        *,
        idle_rest_s: float = REST_S,
    ) -> None:
        """Subscribe as tf2 does: `/tf` reliable and volatile, `/tf_static` latched, 100 deep.

        `on_change` runs in the node's thread; `awaited`, which runs in another, is the stamp that TF must have reached to be of use, `ALWAYS`
        where nothing waits: then the listener looks every `idle_rest_s` seconds.
        """
        self._idle_rest_s = idle_rest_s
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
        self._spinner = Spinner(ears, REST_S)
        topics = (node.resolve_topic_name("/tf"), node.resolve_topic_name("/tf_static"))
        ears.create_subscription(TFMessage, topics[0], lambda cdr: self._add(cdr, static=False), qos.TF, raw=True)
        ears.create_subscription(TFMessage, topics[1], lambda cdr: self._add(cdr, static=True), qos.TF_STATIC, raw=True)
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

    def _add(self, cdr: bytes, *, static: bool) -> None:
        reached = NEVER
        try:
            transforms = read_transforms(cdr)
            reached = max((t.stamp_ns for t in transforms), default=NEVER)
            if not static and self._node.left_over(reached):
                return
            for transform in transforms:
                self._buffer.put(transform, static=static)
        except TransformError as error:
            self._refuse(str(error))
        self.messages += 1
        if not static:
            self._heard = time.monotonic()
        awaited = self._awaited()
        self._spinner.rest(self._idle_rest_s if awaited == ALWAYS else REST_S)
        if static or reached >= awaited:
            self._wake.trigger()

    def _refuse(self, why: str) -> None:
        if not self.refused:
            self._log.error(f"transform refused: {why}")
        self.refused += 1
