# SPDX-License-Identifier: Apache-2.0
"""The bond between a managed node and a lifecycle manager (nav2's): heartbeats that tell the manager when the node dies."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any
from uuid import uuid4

from rclpy.clock import Clock, ClockType

from tof_core.errors import UsageError
from tof_ros import qos
from tof_ros.interfaces import message_class

if TYPE_CHECKING:
    from rclpy.lifecycle import LifecycleNode

TOPIC = "bond"
"""Where nav2's nodes have it: in the node's namespace."""
MISSED = 4.0
"""Heartbeats may be missing for so many seconds: nav2's `bond_timeout`."""


class Bond:
    """One side of a bond (bond_core): it beats until `close`, or until the other side says that it ends.

    Both sides publish `bond/Status` with one `id`, the node's name, each with an `instance_id` of its own. Whoever ends publishes
    `active: false`, which the other side answers with the same.
    """

    def __init__(self, node: LifecycleNode, period_s: float) -> None:
        """Beat every `period_s`.

        Raises:
            UsageError: this host has no package bond.
        """
        kind = message_class("bond/msg/Status")
        if kind is None:
            raise UsageError("bond/Status is not installed", where="live.bond_s", todo="install ros-jazzy-bond, or set it to 0")
        self._node, self._kind, self._period_s, self._open = node, kind, period_s, True
        self._id, self._instance = node.get_name(), str(uuid4())
        self._publisher = node.create_publisher(kind, TOPIC, qos.OUTPUT)
        self._subscription = node.create_subscription(kind, TOPIC, self._take, qos.RECORD)
        self._timer = node.create_timer(period_s, self._beat, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def close(self) -> None:
        """Tell the other side, beat no more."""
        if self._open:
            self._send(active=False)
        self._open = False
        self._node.destroy_timer(self._timer)
        self._node.destroy_subscription(self._subscription)
        self._node.destroy_publisher(self._publisher)

    def _beat(self) -> None:
        if self._open:
            self._send(active=True)

    def _take(self, message: Any) -> None:
        if message.id == self._id and message.instance_id != self._instance and not message.active and self._open:
            self._send(active=False)
            self._open = False
            self._node.get_logger().info("the lifecycle manager ended its bond")

    def _send(self, *, active: bool) -> None:
        message = self._kind(
            id=self._id, instance_id=self._instance, active=active, heartbeat_timeout=MISSED, heartbeat_period=self._period_s
        )
        message.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(message)
