# SPDX-License-Identifier: Apache-2.0
"""What a node hears: its topics, and one line with topic, publishers, candidates and remedy where no frame comes."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

from tof_core.topics import IMAGE, POINTS, depth_candidates

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from rclpy.node import Node

    from tof_ros.diagnostics import Tally

SILENT_S = 5.0
"""No frame for so long is worth a line: every camera that is known gives one within a second."""


CAMERA_SILENT = "check that the camera streams (some stream on demand only), and that the network lets large messages through"
VIEWS_SILENT = (
    "see its log or diagnostics first, it publishes nothing while it hears no camera; if it keeps frames, check that the network lets large"
    " messages through"
)
"""What to do where a topic has a publisher and no message comes: of a camera, and of the node `preproc`."""


@dataclass(frozen=True, slots=True)
class Frames:
    """The topic whose messages are a node's frames: as the node names it, as ROS resolves it, and the parameter that names another."""

    name: str
    topic: str
    kind: str
    parameter: str = ""


class Hearing:
    """The subscriptions of one node, and whether frames come."""

    def __init__(self, node: Node, tally: Tally) -> None:
        """Nothing is subscribed to yet."""
        self._node, self._tally = node, tally
        self._topics: list[str] = []
        self._frames: Frames | None = None
        self._since = time.monotonic()
        self._silent = self._greeted = False

    def add(self, name: str, kind: type, parameter: str | None) -> None:
        """A subscription; the one that brings the frames has a `parameter` (empty: none names it)."""
        topic = self._node.resolve_topic_name(name)
        self._topics.append(topic)
        if parameter is not None:
            self._frames = Frames(name, topic, f"{kind.__module__.partition('.')[0]}/msg/{kind.__name__}", parameter)

    def begin(self) -> None:
        """All subscriptions are made: say so, count from now."""
        self._since = time.monotonic()
        self._silent = self._greeted = False
        self._node.get_logger().info(f"active, hears {', '.join(self._topics) or 'nothing'}")

    def end(self) -> None:
        """Nothing is heard any more."""
        self._topics.clear()
        self._frames = None

    def silence(self) -> str:
        """One line if no frame has come for `SILENT_S`, else empty; the first frame, and the first after a silence, is logged."""
        if self._frames is None:
            return ""
        last = max(self._tally.last_arrival, self._since)
        if time.monotonic() - last > SILENT_S:
            self._silent = True
            return self._line(self._frames)
        if self._tally.last_arrival > self._since and (self._silent or not self._greeted):
            self._node.get_logger().info(f"frames come on {self._frames.topic}")
            self._silent, self._greeted = False, True
        return ""

    def _line(self, frames: Frames) -> str:
        publishers = sorted({_full_name(p) for p in self._node.get_publishers_info_by_topic(frames.topic)})
        if publishers:
            todo = CAMERA_SILENT if frames.parameter else VIEWS_SILENT
            return f"no frame for {SILENT_S:.0f} s: {frames.topic} has publishers ({', '.join(publishers)}), but no message arrived: {todo}"
        types = {topic: found[0] for topic, found in self._node.get_topic_names_and_types() if len(found) == 1}
        published = {topic: kind for topic, kind in types.items() if self._node.count_publishers(topic)}
        return no_publisher(frames, published, self._node.get_name(), self._node.get_namespace())


def _full_name(publisher: object) -> str:
    return f"{str(getattr(publisher, 'node_namespace', '')).rstrip('/')}/{getattr(publisher, 'node_name', '')}"


def no_publisher(frames: Frames, published: Mapping[str, str], node: str, namespace: str) -> str:
    """The line for a topic that nobody publishes: what else could be meant, and the flag that says so.

    Args:
        frames: the node's topic.
        published: type of each topic that has a publisher.
        node: name of the node, as its parameters are addressed.
        namespace: of the node, `/` where it has none.
    """
    line = f"no frame for {SILENT_S:.0f} s: {frames.topic} has no publisher"
    if found := elsewhere(frames, published):
        spaces = [topic.removesuffix(f"/{frames.name}").strip("/") for topic in found]
        flag = f"--namespace {spaces[0]} (ros2 run: -r __ns:=/{spaces[0]})" if spaces[0] else "no --namespace"
        return f"{line}; it is published as {', '.join(found)}: start this node with {flag}"
    if frames.parameter and (found := depth_candidates(published)):
        name = frames.parameter if published[found[0]] == frames.kind else _other(frames.parameter, published[found[0]])
        flag = f"--param {node}.{name}={found[0]} (ros2 run: -p {name}:={found[0]})"
        return f"{line}; depth may be on {', '.join(found)}: pass {flag}"
    if frames.parameter:
        return f"{line}, and no other topic here looks like depth; does the driver run, in this ROS_DOMAIN_ID, within reach of discovery?"
    return f"{line}; start the node that publishes it{f' in the namespace {namespace}' if namespace != '/' else ''}"


def elsewhere(frames: Frames, published: Mapping[str, str]) -> Sequence[str]:
    """Topics of the same name and type in other namespaces."""
    suffix = f"/{frames.name.lstrip('/')}"
    return sorted(t for t, kind in published.items() if t.endswith(suffix) and t != frames.topic and kind == frames.kind)


def _other(parameter: str, kind: str) -> str:
    """The parameter that names a topic of another type: an image where a cloud was looked for, or the other way."""
    room = parameter.rpartition(".")[0]
    return {IMAGE: f"{room}.depth_topic", POINTS: f"{room}.points_topic"}.get(kind, parameter)
