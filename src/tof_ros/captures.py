# SPDX-License-Identifier: Apache-2.0
"""The frames of a camera, received by a node: joined by stamp, each waited for no longer than its patience allows."""

from __future__ import annotations

import time
from collections import deque
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from sensor_msgs.msg import CameraInfo, Temperature

from tof_core.builder import LATE
from tof_core.decode import stamp_ns
from tof_core.errors import RefusedError, ToftwinError
from tof_core.jump import BackwardJump
from tof_ros import messages, qos
from tof_ros.base import LEFT_OVER
from tof_ros.patience import NEVER, Patience
from tof_ros.ticker import Ticker

if TYPE_CHECKING:
    from collections.abc import Callable

    from tof_core.builder import CaptureBuilder
    from tof_core.capture import Capture
    from tof_core.topics import Topics
    from tof_ros.managed import ManagedNode


class CaptureFeed:
    """Subscribes a node to depth, CameraInfo, amplitude and temperature, and hands it each capture in the order of stamps.

    The amplitude is waited for from its first image on. A capture that `take` refuses is skipped and counted. The node's tally and its
    `done` topic are served here.
    """

    def __init__(
        self,
        node: ManagedNode[Any],
        builder: CaptureBuilder,
        topics: Topics,
        take: Callable[[Capture], None],
        refused: Callable[[str], None],
        settled: Callable[[int], bool] = lambda _: True,
        *,
        patience_s: float,
        reliable: bool,
    ) -> None:
        """Subscribe.

        Args:
            node: whose inputs these are.
            builder: of captures, with its options.
            topics: of the camera.
            take: called with each capture, in the node's thread.
            refused: called with the reason where `take` raises `RefusedError`.
            settled: whether what else the capture of a stamp needs is there.
            patience_s: longest wait of a frame, seconds.
            reliable: whether to ask for reliable QoS.
        """
        self._node, self._builder, self._topics = node, builder, topics
        self._take, self._refused, self._settled = take, refused, settled
        self._waiting = deque[Any]()
        self._arrivals: dict[int, float] = {}
        self._patience, self._jump, self._overdue = Patience(patience_s), BackwardJump(), NEVER
        builder.topics = replace(topics, amplitude="")
        builder.on_skip = lambda stamp, reason: self._skipped(stamp, reason, builder.last_error)
        sensor = qos.sensor(reliable=reliable, depth=32)
        node.input(topics.depth, messages.image_class(topics.depth), self._frame, sensor, frames="input.depth_topic")
        node.input(topics.info, CameraInfo, self._info, sensor)
        if topics.amplitude:
            node.input(topics.amplitude, messages.image_class(topics.amplitude), self._amplitude, sensor)
        if topics.temperature:
            node.input(topics.temperature, Temperature, builder.temperature, sensor)
        self._ticker = Ticker(node, self._tick)

    @property
    def oldest(self) -> int:
        """Stamp of the frame that has waited longest."""
        return self._patience.oldest

    def advance(self, *, final: bool = False) -> None:
        """Hand out the captures that are complete, or all that wait where no more will come (`final`)."""
        self._waiting.extend(self._builder.ready(final=final))
        while self._waiting and (final or self._ready(self._waiting[0].stamp_ns)):
            capture = self._waiting.popleft()
            try:
                self._take(capture)
            except RefusedError as error:
                self._refused(str(error))
                self._skipped(capture.stamp_ns, "refused", str(error))
            except ToftwinError as error:
                self._skipped(capture.stamp_ns, "bad frame", str(error))
            else:
                self._patience.end(capture.stamp_ns)
                self._jump.clear()
                self._node.done(capture.stamp_ns, self._arrivals.pop(capture.stamp_ns, time.monotonic()))

    def reset(self) -> None:
        """Discard the frames that are waiting."""
        self._builder.reset()
        self._waiting.clear()
        self._node.forget_frames(self._arrivals)
        self._patience.clear()
        self._jump.clear()

    def flush(self) -> str:
        """Give out every frame that waits, as at the end of a bag."""
        waiting = len(self._builder.waiting) + len(self._waiting)
        self.advance(final=True)
        return f"{waiting} frames waited"

    def _ready(self, stamp: int) -> bool:
        return self._settled(stamp) or stamp <= self._overdue

    def _frame(self, message: Any) -> None:
        arrived, stamp = self._node.tally.arrived(), stamp_ns(message)
        if self._node.left_over(stamp):
            self._node.skip(stamp, LEFT_OVER)
            return
        self._arrivals[stamp] = arrived
        self._patience.start(stamp)
        self._ticker.start()
        self._builder.depth(message)
        if self._jump:
            self._node.jumped()
        self.advance()

    def _info(self, message: CameraInfo) -> None:
        self._builder.info(message)
        self.advance()

    def _amplitude(self, message: Any) -> None:
        # Seen for the first time: from now on it is waited for.
        self._builder.topics = self._topics
        self._builder.amplitude(message)
        self.advance()

    def _tick(self) -> bool:
        """Give up waiting for what does not come; whether a frame still waits."""
        self._overdue = max(self._overdue, self._patience.tick())
        self._builder.overdue = max(self._builder.overdue, self._overdue)
        self.advance()
        return bool(self._patience)

    def _skipped(self, stamp: int, reason: str, why: str) -> None:
        if stamp not in self._builder.waiting | {capture.stamp_ns for capture in self._waiting}:  # of a second one the first still waits
            self._patience.end(stamp)
            self._arrivals.pop(stamp, None)
        self._node.skip(stamp, reason, why)
        if reason == LATE:
            self._jump.late(stamp, self._builder.last_stamp)
