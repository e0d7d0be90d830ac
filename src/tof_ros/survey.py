# SPDX-License-Identifier: Apache-2.0
"""Survey of a ROS domain: topics, publishers with their QoS, and a short recording."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

import rclpy

from tof_core.topics import is_own
from tof_ros import qos
from tof_ros.environment import ros_context
from tof_ros.interfaces import message_class
from tof_ros.recorder import Recorder
from tof_ros.spin import spinning

if TYPE_CHECKING:
    from collections import Counter
    from collections.abc import Collection, Iterator
    from pathlib import Path

    from rclpy.node import Node

DISCOVERY_S = 2.0
"""DDS has found the publishers of this host by then."""


@dataclass(frozen=True, slots=True)
class Publisher:
    """One publisher of a topic: its node and what it offers (`reliable` or `best_effort`, `volatile` or `transient_local`)."""

    node: str
    reliability: str
    durability: str


@dataclass(frozen=True, slots=True)
class Seen:
    """Publishers by topic, how many messages of each were recorded, and the outputs of this project's own nodes, which were not."""

    publishers: dict[str, list[Publisher]]
    counts: Counter[str]
    own: tuple[str, ...] = ()


def middleware_name() -> str:
    """The middleware that rclpy would use here."""
    from rclpy.utilities import get_rmw_implementation_identifier

    return str(get_rmw_implementation_identifier())


def watch_types(period_s: float = 0.25) -> Iterator[dict[str, str]]:
    """The type of each topic that has a publisher, again and again until the caller has seen enough."""
    with ros_context() as context:
        node = rclpy.create_node("toftwin_survey", context=context, start_parameter_services=False)
        with spinning([node]):
            while True:
                time.sleep(period_s)
                named = {topic: found[0] for topic, found in node.get_topic_names_and_types() if len(found) == 1}
                yield {topic: kind for topic, kind in named.items() if node.count_publishers(topic)}


def survey(path: Path, kinds: Collection[str], seconds: float) -> Seen:
    """Record every topic of some types for a while into a new bag at `path`; sensors are heard best-effort, which hears all."""
    with ros_context() as context:
        node = rclpy.create_node("toftwin_doctor", context=context, start_parameter_services=False)
        with spinning([node]):
            time.sleep(DISCOVERY_S)
            types = {topic: found[0] for topic, found in node.get_topic_names_and_types() if len(found) == 1 and found[0] in kinds}
            own = tuple(sorted(topic for topic in types if is_own(topic) and node.count_publishers(topic)))
            types = {topic: kind for topic, kind in types.items() if not is_own(topic)}
            publishers = {topic: offers for topic in sorted(types) if (offers := _publishers(node, topic))}
            classes = [(topic, kind) for topic in publishers if (kind := message_class(types[topic])) is not None]
            recorder = Recorder(node, path, classes, qos.sensor(depth=64))
            time.sleep(seconds)
            recorder.close()
    return Seen(publishers, recorder.counts, own)


def _publishers(node: Node, topic: str) -> list[Publisher]:
    return [
        Publisher(
            f"{p.node_namespace.rstrip('/')}/{p.node_name}", p.qos_profile.reliability.name.lower(), p.qos_profile.durability.name.lower()
        )
        for p in node.get_publishers_info_by_topic(topic)
    ]
