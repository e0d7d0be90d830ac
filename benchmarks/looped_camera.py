# SPDX-License-Identifier: Apache-2.0
"""A recorded session played over DDS again and again, restamped, at any rate: the cameras and the robot of a long run."""

from __future__ import annotations

import threading
import time
from collections import defaultdict
from typing import TYPE_CHECKING, Any

import numpy as np
from rclpy.serialization import deserialize_message

from tof_core import decode
from tof_preproc.stream import ACCUMULATED, KEPT
from tof_ros import messages, qos
from tof_ros.interfaces import message_class
from tof_ros.views import DWELL

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from rclpy.node import Node

    from tof_core.bag import BagReader

ROOMS = ("preproc", "label", "infer")
IN_FLIGHT = 3
"""Frames without an answer at which a paced camera waits: a frame is answered once the transforms after it have come."""
STEP_NS = 100_000_000
"""Between the stamps of two plays."""
PACED_TF_S = 0.001
"""Between two transforms of a paced camera: those of a drive must not overrun a queue that a robot's fill in seconds."""
PACED_S = 5.0
"""A paced camera waits no longer for an answer: that frame is lost."""


class LoopedCamera:
    """Publishes a bag's messages at `hz` frames a second on average, and hears what became of each frame.

    Stamps are this host's clock, rising through all loops; so that TF covers its frames, messages go out in the order of their stamps.
    With `namespaces` there are several cameras of one robot, each with the same frames under a namespace of its own. A `paced` camera
    sends as fast as the graph answers: processor time a frame can so be measured on a host where others work, too.
    """

    def __init__(
        self,
        node: Node,
        reader: BagReader,
        hz: float,
        namespaces: Sequence[str] = ("",),
        rooms: Sequence[str] = ROOMS,
        *,
        paced: bool = False,
    ) -> None:
        """Read the bag into memory, find the graph's topics; `rooms` are those that run."""
        from geometry_msgs.msg import PoseWithCovarianceStamped
        from sensor_msgs.msg import Image, TimeReference

        self._node, self._frames_topic, self._hz, self.paced = node, reader.topics.depth, hz, paced
        wanted = [t for t in reader.types if t != "/tf_static" and not t.startswith(("/diagnostics", "/rosout"))]
        raw = list(reader.messages(tuple(wanted)))
        kinds = {m.topic: message_class(m.type) for m in raw}
        self._events = [(m.stamp_ns, m.topic, deserialize_message(m.cdr, kinds[m.topic])) for m in raw]
        frames = [stamp for stamp, topic, _ in self._events if topic == self._frames_topic]
        step_ns = (frames[-1] - frames[0]) / (len(frames) - 1)
        self._speed = 1.0 if paced else hz * step_ns * 1e-9
        self._first, self._loop_ns = raw[0].stamp_ns, round(raw[-1].stamp_ns - raw[0].stamp_ns + step_ns)
        spaces = [f"/{name}" if name else "" for name in namespaces]
        self._out = {
            topic: [node.create_publisher(kind, topic, qos.TF)]
            if topic == "/tf"
            else [node.create_publisher(kind, space + topic, qos.sensor(reliable=True, depth=64)) for space in spaces]
            for topic, kind in kinds.items()
        }
        self._static = node.create_publisher(message_class("tf2_msgs/msg/TFMessage"), "/tf_static", qos.TF_STATIC)
        for m in reader.messages(("/tf_static",)):
            self._static.publish(deserialize_message(m.cdr, message_class(m.type)))
        self.sent: dict[int, float] = {}
        self.fates: dict[str, dict[int, str]] = defaultdict(dict)
        self.latencies: list[float] = []
        self.labels = 0
        self.behind_s = 0.0
        self._newest_ns = 0
        self._stop = threading.Event()
        self._spaces, self._each = spaces, rooms
        self.rooms = tuple(f"{name}/{room}" if name else room for name in namespaces for room in rooms)
        for room in self.rooms:
            node.create_subscription(TimeReference, f"/{room}/done", lambda m, room=room: self._answered(room, m), qos.RECORD)
        for space in spaces:
            node.create_subscription(Image, f"{space}/infer/depth", self._inferred, qos.RECORD)
            node.create_subscription(PoseWithCovarianceStamped, f"{space}/label/pose", self._labelled, qos.RECORD)

    def _answered(self, room: str, message: Any) -> None:
        stamp = decode.stamp_ns(message)
        self.fates[room][stamp] = message.source
        if message.source == ACCUMULATED:  # its label is that of a later view
            self.fates[room.removesuffix("preproc") + "label"][stamp] = ACCUMULATED

    def _labelled(self, _: Any) -> None:
        self.labels += 1

    def _inferred(self, message: Any) -> None:
        if (sent := self.sent.get(decode.stamp_ns(message))) is not None:
            self.latencies.append(time.monotonic() - sent)

    @property
    def heard(self) -> bool:
        """Whether every node of the graph listens."""
        listeners = len({"preproc", "infer"} & set(self._each))
        frames = all(publisher.get_subscription_count() >= listeners for publisher in self._out[self._frames_topic])
        return frames and ("label" not in self._each or all(self._node.count_subscribers(f"{s}/preproc/{DWELL}") for s in self._spaces))

    def warm_up(self, alive: Callable[[], bool], seconds: float = 120.0) -> bool:
        """Play until every room has kept a second's frames, then forget them; whether that came to be.

        A writer sends to the readers that it has met: on a busy host some of a node's topics meet theirs seconds after others.
        """
        player = threading.Thread(target=self.play, args=(seconds,))
        player.start()
        while player.is_alive() and alive() and not self._flowing():
            player.join(0.2)
        flowing = self._flowing()
        self.stop()
        player.join()
        self.settle(2.0)
        self._stop.clear()
        self.sent.clear()
        self.latencies.clear()
        self.labels = 0
        return flowing

    def _flowing(self) -> bool:
        """Whether every room has lately kept as many frames as are sent in a second."""
        most = 15 if self.paced else max(round(self._hz), 1)
        return all(sum(fate in (KEPT, ACCUMULATED) for fate in tuple(self.fates[room].values())[-most:]) >= most for room in self.rooms)

    def play(self, seconds: float) -> float:
        """Publish for so long (or until `stop`); gives the rate that was reached, in frames a second; `behind_s` the most it was late."""
        self.behind_s = 0.0
        before, begin = len(self.sent), time.monotonic()
        # A paced camera's stamps may run ahead of the clock: what is played next must not be late for that.
        start_ns = max(time.time_ns(), self._newest_ns + STEP_NS)
        loop = 0
        while not self._stop.is_set() and time.monotonic() - begin < seconds:
            for stamp, topic, message in self._events:
                due = (stamp - self._first + loop * self._loop_ns) / self._speed
                # The last frame's transforms come after it: what follows is still sent, up to the next frame.
                passed = time.monotonic() - begin if self.paced else due * 1e-9
                over = passed > seconds and topic == self._frames_topic
                if over or self._wait(due * 1e-9 - (time.monotonic() - begin), topic):
                    break
                self.behind_s = max(self.behind_s, time.monotonic() - begin - due * 1e-9)
                self._send(topic, message, start_ns + round(due))
            loop += 1
        return (len(self.sent) - before) / (time.monotonic() - begin)

    def _wait(self, seconds: float, topic: str) -> bool:
        """Wait until a message is due; whether the camera was stopped meanwhile."""
        if not self.paced:
            return self._stop.wait(max(seconds, 0.0))
        if topic == "/tf":
            time.sleep(PACED_TF_S)
        deadline = time.monotonic() + PACED_S
        while topic == self._frames_topic and self._unanswered() >= IN_FLIGHT and time.monotonic() < deadline:
            if self._stop.wait(0.005):
                return True
        return self._stop.is_set()

    def _unanswered(self) -> int:
        """Of the last frames those that some room has not answered."""
        last = tuple(self.sent)[-IN_FLIGHT:]
        return max(sum(stamp not in self.fates[room] for stamp in last) for room in self.rooms)

    def _send(self, topic: str, message: Any, stamp_ns: int) -> None:
        stamp = messages.to_stamp(stamp_ns)
        for part in getattr(message, "transforms", None) or [message]:
            part.header.stamp = stamp
        if topic == self._frames_topic:
            self.sent[stamp_ns] = time.monotonic()
        self._newest_ns = stamp_ns
        for publisher in self._out[topic]:
            publisher.publish(message)

    def stop(self) -> None:
        """End `play` early."""
        self._stop.set()

    def lost(self, room: str) -> int:
        """Frames that a room has neither kept nor accumulated; those that preproc skipped count here too. May be asked while others send."""
        fates = self.fates[room]
        return sum(fates.get(stamp) not in (KEPT, ACCUMULATED) for stamp in tuple(self.sent))

    def settle(self, seconds: float = 15.0) -> None:
        """Wait until every room has answered, as long as answers come."""
        deadline = time.monotonic() + seconds
        while time.monotonic() < deadline and any(not self.sent.keys() <= self.fates[room].keys() for room in self.rooms):
            time.sleep(0.1)

    def latency_ms(self, percentile: float) -> float:
        """From publishing a raw frame to hearing its repaired one."""
        latencies = tuple(self.latencies)
        return 1e3 * float(np.percentile(latencies, percentile)) if latencies else float("nan")
