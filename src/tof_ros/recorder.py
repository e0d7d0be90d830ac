# SPDX-License-Identifier: Apache-2.0
"""Writes topics to a bag as they arrive, byte for byte; every message before a crash stays readable."""

from __future__ import annotations

import threading
import time
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rclpy.clock import Clock, ClockType

from tof_core.errors import BagError, RefusedError
from tof_ros import qos

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from rclpy.node import Node
    from rclpy.qos import QoSProfile

    from tof_ros.base import RoomNode

FLUSH_S = 0.2
"""Longest time in seconds until a received message is in the file, also if no other follows: a killed process loses no more."""
TF_QOS = {"/tf": qos.TF, "/tf_static": qos.TF_STATIC}
"""TF is heard as tf2 hears it, whatever the profile of the other topics."""
Topic = tuple[str, type[Any]]
"""A topic's name and its message class."""


class Recorder:
    """Subscribes to topics and keeps what they carry; while it is `paused` it keeps TF alone, which frames need of before them."""

    paused = False

    def __init__(self, node: Node, path: Path, topics: Iterable[Topic], profile: QoSProfile = qos.RECORD) -> None:
        """Record `topics` (name and message class) into a new bag at `path`."""
        from tof_core.bag_writer import BagWriter

        self._node, self.path, self.counts, self._profile = node, path, Counter[str](), profile
        self.failed = ""
        # `close` is called while another thread spins the node: a chunk must not be finished in the middle of a write.
        self._lock, self._closed = threading.Lock(), False
        self._writer = BagWriter(path).__enter__()
        self._subscriptions: list[Any] = []
        for topic, kind in topics:
            self.add(topic, kind)
        self._flusher = node.create_timer(FLUSH_S, lambda: self._try(self._writer.flush), clock=Clock(clock_type=ClockType.STEADY_TIME))

    def add(self, topic: str, kind: type[Any]) -> None:
        """Record this topic too, from now on."""
        name = self._node.resolve_topic_name(topic)
        package, _, module = kind.__module__.partition(".msg.")
        type_name = f"{package}/msg/{kind.__name__}" if module else kind.__name__
        profile = TF_QOS.get(name, self._profile)
        self._subscriptions.append(
            self._node.create_subscription(kind, name, lambda data: self._write(name, type_name, data), profile, raw=True)
        )

    def _write(self, topic: str, type_name: str, data: bytes) -> None:
        now = self._node.get_clock().now().nanoseconds

        def keep() -> None:
            if not self.paused or topic in TF_QOS:
                self._writer.raw(topic, type_name, data, now)
            self.counts[topic] += 1

        self._try(keep)

    def _try(self, write: Callable[[], None]) -> None:
        """A disk that is full ends the recording, not the node; what was written before stays readable."""
        with self._lock:
            if self.failed or self._closed:
                return
            try:
                write()
            except BagError as error:
                self.failed = f"recording stopped: {error}"
                self._node.get_logger().error(self.failed)

    @property
    def topics(self) -> set[str]:
        """Topics that are recorded, by their full names."""
        return {subscription.topic_name for subscription in self._subscriptions}

    @property
    def count(self) -> int:
        """Messages that came so far."""
        return self.counts.total()

    @property
    def mute(self) -> list[str]:
        """Topics that nobody publishes."""
        return [s.topic_name for s in self._subscriptions if not s.get_publisher_count()]

    @property
    def even(self) -> bool:
        """Whether the topics of each room that carry anything have carried as many messages: a room's outputs come together."""
        rooms: dict[str, set[int]] = {}
        for topic, count in dict(self.counts).items():  # a copy: another thread counts
            rooms.setdefault(topic.rpartition("/")[0], set()).add(count)
        return all(len(counts) == 1 for counts in rooms.values())

    def settle(self, quiet_s: float = 0.5, give_up_s: float = 10.0) -> None:
        """Wait until nothing has come for a while (another thread must spin the node).

        A large message that lost a fragment is sent again only at the next heartbeat, three seconds later: uneven topics are waited for.
        """
        before, end = -1, time.monotonic() + give_up_s
        while self.count != before or (not self.even and time.monotonic() < end):
            before = self.count
            time.sleep(quiet_s)

    def close(self) -> None:
        """Stop and finish the bag; messages that come later are dropped."""
        self._node.destroy_timer(self._flusher)
        for subscription in self._subscriptions:
            self._node.destroy_subscription(subscription)
        self._try(self._finish)

    def _finish(self) -> None:
        self._closed = True
        self._writer.__exit__(None, None, None)


class RecordService:
    """The services `~/start_recording` and `~/stop_recording` of a node: one bag a call, named by robot and wall clock."""

    def __init__(
        self, node: RoomNode[Any], folder: Callable[[], str], prefix: str, topics: Sequence[Topic], profile: QoSProfile = qos.RECORD
    ) -> None:
        """Bags are made in what `folder` says, which a node without recordings leaves empty."""
        self._node, self._folder, self._prefix, self._topics, self._profile = node, folder, prefix, topics, profile
        self._recorder: Recorder | None = None
        node.service("start_recording", self._start)
        node.service("stop_recording", self._stop)
        node.warns.append(self._warnings)
        node.at_end.append(self._close)

    def _start(self) -> str:
        if not (folder := self._folder()):
            raise RefusedError("no folder to record to", where="live.record", todo="start the node with -p live.record:=FOLDER")
        if self._recorder is not None and not self._recorder.failed:
            raise RefusedError("already recording", where=self._recorder.path)
        self._close()
        robot = self._node.get_namespace().strip("/").replace("/", "_")  # several robots may share the folder
        name = "_".join(part for part in (robot, self._prefix, time.strftime("%Y%m%d_%H%M%S")) if part)
        path = Path(folder) / name
        path.parent.mkdir(parents=True, exist_ok=True)
        self._recorder = Recorder(self._node, path, self._topics, self._profile)
        return f"recording to {path}"

    def _stop(self) -> str:
        if self._recorder is None:
            raise RefusedError("nothing is being recorded", todo="call ~/start_recording first")
        recorder = self._recorder
        self._close()
        if recorder.failed:
            raise RefusedError(recorder.failed)
        return f"{recorder.count} messages in {recorder.path}"

    def _close(self) -> None:
        recorder, self._recorder = self._recorder, None
        if recorder is not None:
            recorder.close()

    def _warnings(self) -> list[str]:
        return [self._recorder.failed] if self._recorder is not None and self._recorder.failed else []
