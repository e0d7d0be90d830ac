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
    from collections.abc import Collection, Iterator, Mapping, Sequence
    from pathlib import Path

    from rclpy.node import Node

PATIENCE_S = 10.0
"""Longest wait for a topic to be found and heard: DDS announces a process every three seconds, and a busy host loses one or two of them."""
LOOK_S = 0.1
"""From one look at the graph to the next."""


@dataclass(frozen=True, slots=True)
class Publisher:
    """One publisher of a topic: its node and what it offers (`reliable` or `best_effort`, `volatile` or `transient_local`)."""

    node: str
    reliability: str
    durability: str


@dataclass(frozen=True, slots=True)
class Seen:
    """Publishers by topic, how many messages of each came in how many seconds, and the outputs of this project's own nodes, which were not."""

    publishers: dict[str, list[Publisher]]
    counts: Counter[str]
    seconds: float
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


def survey(path: Path, kinds: Collection[str], seconds: float, needed: Sequence[Collection[str]] = ()) -> Seen:
    """Record every topic of some types into a new bag at `path`; sensors are heard best-effort, which hears all.

    The `seconds` begin once every published topic, and of each group of types in `needed` at least one, was heard, or after `PATIENCE_S`: a
    topic that is not found yet is not a topic that is missing.
    """
    with ros_context() as context:
        node = rclpy.create_node("toftwin_doctor", context=context, start_parameter_services=False)
        with spinning([node]):
            recorder = Recorder(node, path, (), qos.sensor(depth=64))
            recorder.paused, began = True, time.monotonic()
            while not _whole(_follow(recorder, _published(node, kinds)), recorder.counts, needed):
                if time.monotonic() - began > PATIENCE_S:
                    break
                time.sleep(LOOK_S)
            recorder.paused, begins = False, time.monotonic()
            while time.monotonic() - begins < seconds:
                _follow(recorder, _published(node, kinds))
                time.sleep(LOOK_S)
            own = tuple(sorted(_published(node, kinds, own=True)))
            publishers = {topic: offers for topic in sorted(recorder.topics) if (offers := _publishers(node, topic))}
            took = time.monotonic() - began
            recorder.close()
    return Seen(publishers, recorder.counts, took, own)


def _published(node: Node, kinds: Collection[str], *, own: bool = False) -> dict[str, str]:
    """The type of each topic of some types that has a publisher: of this project's own nodes, or of all others."""
    types = {topic: found[0] for topic, found in node.get_topic_names_and_types() if len(found) == 1 and found[0] in kinds}
    return {topic: kind for topic, kind in types.items() if is_own(topic) is own and node.count_publishers(topic)}


def _follow(recorder: Recorder, types: dict[str, str]) -> dict[str, str]:
    """Record the topics that were found since the last look, too; gives all."""
    for topic in types.keys() - recorder.topics:
        if (kind := message_class(types[topic])) is not None:
            recorder.add(topic, kind)
    return types


def _whole(types: Mapping[str, str], counts: Mapping[str, int], needed: Sequence[Collection[str]]) -> bool:
    """Whether every topic was heard (a latched one speaks only once, perhaps to others) and none of the needed types is missing."""
    heard = {kind for topic, kind in types.items() if counts.get(topic)}
    silent = [topic for topic in types if not counts.get(topic) and not topic.endswith("/tf_static")]
    return not silent and all(heard.intersection(group) for group in needed)


def _publishers(node: Node, topic: str) -> list[Publisher]:
    return [
        Publisher(
            f"{p.node_namespace.rstrip('/')}/{p.node_name}", p.qos_profile.reliability.name.lower(), p.qos_profile.durability.name.lower()
        )
        for p in node.get_publishers_info_by_topic(topic)
    ]
