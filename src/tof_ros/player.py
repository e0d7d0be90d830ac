# SPDX-License-Identifier: Apache-2.0
"""Plays a bag into the running graph over DDS, with the bag's clock, no faster than the graph can process it."""

from __future__ import annotations

import threading
import time
from collections import Counter
from dataclasses import dataclass, field
from itertools import islice
from typing import TYPE_CHECKING, Any

from rclpy.node import Node
from rclpy.serialization import deserialize_message
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import TimeReference
from std_srvs.srv import Trigger
from tf2_msgs.msg import TFMessage

from tof_core import decode
from tof_core.errors import ToftwinError
from tof_ros import messages, qos
from tof_ros.ending import PLAYER
from tof_ros.interfaces import message_class

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

    from rclpy.context import Context
    from rclpy.publisher import Publisher
    from rclpy.qos import QoSProfile

    from tof_core.arrays import Float
    from tof_core.bag import RawMessage

DISCOVERY_S = 1.0
"""Time after discovering all nodes in which these discover each other, seconds."""
LOSS_S = 10.0
"""Longest silence of the graph in real time, seconds: more than the 8 s for which a frame may wait for its transform."""
MERGED = 200
"""Transform messages that are sent as one."""
LEAD_NS = 1_000_000_000
LAST_NS = 2**63 - 1


class ReplayError(ToftwinError):
    """The graph does not subscribe or does not answer."""


@dataclass(frozen=True, slots=True)
class PlayOptions:
    """How a bag is played.

    Args:
        realtime: keep the bag's pace and wait for nobody; frames may be lost.
        rate: speed in real time, as a multiple of the bag's.
        in_flight: frames sent ahead of the graph's answers; below the depth of every queue between nodes.
        give_up_s: how long the graph may be silent; frames then open are lost. Less in real time, where some are.
    """

    realtime: bool = False
    rate: float = 1.0
    in_flight: int = 8
    give_up_s: float = 60.0

    @property
    def silence_s(self) -> float:
        """Frames that are open after so long a silence are lost."""
        return min(self.give_up_s, LOSS_S) if self.realtime else self.give_up_s


@dataclass(slots=True)
class PlayReport:
    """Results of the frames: sent, and the first node's answers; `lost` were sent and never answered."""

    sent: int = 0
    fates: Counter[str] = field(default_factory=Counter)
    lost: int = 0
    seconds: float = 0.0


class Player(Node):
    """The node that publishes a bag. `frames` are the topics whose messages the graph answers on `done` topics."""

    def __init__(self, context: Context, frames: Sequence[str], done: Sequence[str], options: PlayOptions) -> None:
        """`done[0]` is the first node's answer; those after it come for each frame that it kept."""
        super().__init__(PLAYER, context=context)
        self._frames, self._options = set(frames), options
        self._first, self._after = self.resolve_topic_name(done[0]), [self.resolve_topic_name(t) for t in done[1:]]
        self._open: dict[int, set[str]] = {}
        self._changed = threading.Condition()
        self._out: dict[str, Publisher] = {}
        self._next_transform: RawMessage | None = None
        self._clock_ns, self._heard = 0, float("-inf")
        self._alive: Callable[[], bool] = lambda: True
        self._ticker = self.create_publisher(Clock, "/clock", qos.OUTPUT)
        self.report = PlayReport()
        self._out["/clock"] = self._ticker
        self._answers = [
            self.create_subscription(TimeReference, topic, lambda m, t=topic: self._answered(t, m), qos.RECORD)
            for topic in (self._first, *self._after)
        ]

    def _answered(self, topic: str, message: TimeReference) -> None:
        stamp = decode.stamp_ns(message)
        with self._changed:
            self._heard = time.monotonic()
            if topic == self._first:
                self.report.fates[message.source] += 1
            waiting = self._open.get(stamp, set())
            waiting.discard(topic)
            if topic == self._first and message.source != "kept":
                waiting.clear()  # the nodes after it never see the frame
            if not waiting:
                self._open.pop(stamp, None)
            self._changed.notify_all()

    def wait_for_graph(
        self,
        heard: Mapping[str, int],
        alive: Callable[[], bool],
        unpublished: Callable[[], Sequence[str]] = tuple,
        *,
        timeout_s: float = 60.0,
    ) -> None:
        """Until so many listen to each topic of `heard` (`advertise` comes first), all answers can be heard, and `unpublished` is empty."""
        deadline = time.monotonic() + timeout_s
        while True:
            deaf = [t for t, n in heard.items() if self._out[t].get_subscription_count() < n]
            mute = [*(s.topic_name for s in self._answers if not s.get_publisher_count()), *unpublished()]
            if not deaf and not mute:
                time.sleep(DISCOVERY_S)
                return
            if not alive():
                raise ReplayError("the graph stopped while it started", todo="its messages are above")
            if time.monotonic() > deadline:
                lacks = [f"not enough listen to {topic}" for topic in deaf[:1]] + [f"nobody publishes {topic}" for topic in mute[:1]]
                raise ReplayError(f"{' and '.join(lacks)} after {timeout_s:.0f} s", todo="is the graph running in this ROS_DOMAIN_ID?")
            time.sleep(0.05)

    def play(self, bag: Iterable[RawMessage], transforms: Iterable[RawMessage], alive: Callable[[], bool]) -> Iterator[int]:
        """Publish all messages in their order, `/tf` from a stream of its own; yields the stamp of each frame once sent.

        Unless in real time, `/tf` runs `LEAD_NS` ahead of the rest, so that no frame waits for its transform.
        """
        self._alive, begin, start_ns = alive, time.monotonic(), None
        leading = iter(transforms)
        for message in bag:
            start_ns = message.stamp_ns if start_ns is None else start_ns
            if self._options.realtime:
                self._send_realtime(leading, message.stamp_ns, start_ns, begin)
            else:
                self._send_transforms(leading, message.stamp_ns + LEAD_NS)
            is_frame = message.topic in self._frames
            if is_frame:
                self._open_frame(message.stamp_ns)
            self._tick(message.stamp_ns)
            self._publish(message)
            if is_frame:
                self.report.sent += 1
                yield message.stamp_ns
        self._send_transforms(leading, LAST_NS)
        self.report.seconds = time.monotonic() - begin

    def _send_realtime(self, transforms: Iterator[RawMessage], until_ns: int, start_ns: int, begin: float) -> None:
        """Each transform at its time, then wait for the time of what follows."""
        for transform in self._taken(transforms, until_ns):
            self._pause(transform.stamp_ns, start_ns, begin)
            self._publish(transform)
            self._tick(transform.stamp_ns)
        self._pause(until_ns, start_ns, begin)

    def _pause(self, stamp_ns: int, start_ns: int, begin: float) -> None:
        due = (stamp_ns - start_ns) * 1e-9 / self._options.rate
        time.sleep(max(due - (time.monotonic() - begin), 0.0))

    def _taken(self, transforms: Iterator[RawMessage], until_ns: int) -> Iterator[RawMessage]:
        """Those of a stream that are due; the one after is kept for the next call."""
        while (transform := self._next_transform or next(transforms, None)) is not None:
            self._next_transform = transform
            if transform.stamp_ns > until_ns:
                return
            self._next_transform = None
            yield transform

    def _send_transforms(self, transforms: Iterator[RawMessage], until_ns: int) -> None:
        """Many of them in one message: a burst cannot overrun a listener's queue."""
        while batch := list(islice(self._taken(transforms, until_ns), MERGED)):
            merged = [deserialize_message(m.cdr, TFMessage) for m in batch]
            self._publisher("/tf", TFMessage).publish(TFMessage(transforms=[t for m in merged for t in m.transforms]))

    def _open_frame(self, stamp_ns: int) -> None:
        """Wait for room, then note that an answer is due."""
        with self._changed:
            if not self._options.realtime and not self._wait(lambda: len(self._open) < self._options.in_flight):
                raise ReplayError(f"the graph has not answered for {self._options.give_up_s:.0f} s", todo="its messages are above")
            self._open[stamp_ns] = {self._first, *self._after}

    def _wait(self, done: Callable[[], bool]) -> bool:
        """With the lock held: until `done` (true), or nothing was answered for long (false)."""
        began = time.monotonic()
        while not done():
            self._changed.wait(0.05)
            if not self._alive():
                raise ReplayError("the graph stopped during the replay", todo="its messages are above")
            if time.monotonic() - max(self._heard, began) > self._options.silence_s:
                return False
        return True

    def finish(self, flush: Sequence[str]) -> None:
        """Wait for the last answers, then call the `flush` services, which make nodes give out what they hold."""
        with self._changed:
            self._wait(lambda: not self._open)
            self.report.lost = len(self._open)
        for service in flush:
            self._call(service)

    def _call(self, service: str) -> None:
        client = self.create_client(Trigger, service)
        try:
            if not client.wait_for_service(timeout_sec=self._options.give_up_s):
                raise ReplayError("no such service", where=service, todo="is the node running?")
            answer = client.call(Trigger.Request(), timeout_sec=self._options.give_up_s)
            if answer is None or not answer.success:
                raise ReplayError(answer.message if answer else "no answer", where=service)
        finally:
            self.destroy_client(client)

    def _tick(self, stamp_ns: int) -> None:
        """Move the bag's clock on; it never goes back."""
        if stamp_ns > self._clock_ns:
            self._clock_ns = stamp_ns
            self._ticker.publish(Clock(clock=messages.to_stamp(stamp_ns)))

    def _publish(self, message: RawMessage) -> None:
        kind = message_class(message.type)
        if kind is not None:
            self._publisher(message.topic, kind).publish(message.cdr)

    def place(self, parent: str, child: str, T: Float) -> None:
        """Publish a static transform `T_parent_child`: where the cell is, for a robot whose TF does not know it."""
        self._publisher("/tf_static", TFMessage).publish(TFMessage(transforms=[messages.transform(parent, child, T)]))

    def advertise(self, topics: Iterable[tuple[str, str]]) -> None:
        """Make the publishers of (topic, type) before anything is sent, so that listeners find them."""
        for topic, type_name in topics:
            kind = message_class(type_name)
            if kind is None:
                self.get_logger().warning(f"{topic} is not played: this host has no {type_name}")
            else:
                self._publisher(topic, kind)

    def _publisher(self, topic: str, kind: type[Any]) -> Publisher:
        if topic not in self._out:
            self._out[topic] = self.create_publisher(kind, topic, _profile(topic))
        return self._out[topic]


def _profile(topic: str) -> QoSProfile:
    return {"/tf": qos.TF, "/tf_static": qos.TF_STATIC}.get(topic, qos.sensor(reliable=True))
