# SPDX-License-Identifier: Apache-2.0
"""Writes topics to a bag as they come, byte for byte; every message before a crash stays readable."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from tof_ros import qos

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

    from rclpy.node import Node
    from rclpy.qos import QoSProfile


def message_class(type_name: str) -> type[Any] | None:
    """The class of `package/msg/Name`, or None where this host has no such package."""
    package, _, name = type_name.replace("/msg/", "/").partition("/")
    try:
        found: type[Any] = getattr(import_module(f"{package}.msg"), name)
    except (ImportError, AttributeError):
        return None
    return found


class Recorder:
    """Subscribes to topics and keeps what they carry."""

    def __init__(self, node: Node, path: Path, topics: Iterable[tuple[str, type[Any]]], profile: QoSProfile = qos.RECORD) -> None:
        """Record `topics` (name and message class) into a new bag at `path`."""
        from tof_core.bag_writer import BagWriter

        self._node, self.path, self.count = node, path, 0
        self._writer = BagWriter(path).__enter__()
        self._subscriptions = [self._subscribe(topic, kind, profile) for topic, kind in topics]

    def _subscribe(self, topic: str, kind: type[Any], profile: QoSProfile) -> Any:
        name = self._node.resolve_topic_name(topic)
        package, _, module = kind.__module__.partition(".msg.")
        type_name = f"{package}/msg/{kind.__name__}" if module else kind.__name__
        return self._node.create_subscription(kind, name, lambda data: self._write(name, type_name, data), profile, raw=True)

    def _write(self, topic: str, type_name: str, data: bytes) -> None:
        self._writer.raw(topic, type_name, data, self._node.get_clock().now().nanoseconds)
        self.count += 1

    @property
    def matched(self) -> bool:
        """Whether every topic has a publisher."""
        return all(self._node.count_publishers(s.topic_name) for s in self._subscriptions)

    def close(self) -> None:
        """Stop and finish the bag."""
        for subscription in self._subscriptions:
            self._node.destroy_subscription(subscription)
        self._writer.__exit__(None, None, None)
