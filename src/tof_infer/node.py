# SPDX-License-Identifier: Apache-2.0
"""The node `infer`: subscribes to raw depth, publishes corrected depth and its sigma with the frame's stamp."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from sensor_msgs.msg import CameraInfo, Image, Temperature

from tof_core.builder import LATE, CaptureBuilder
from tof_core.config import param, section
from tof_core.decode import stamp_ns
from tof_core.errors import RefusedError, ToftwinError
from tof_core.jump import BackwardJump
from tof_core.live import ManagedOptions
from tof_core.options import NOT_WANTED, BagOptions
from tof_core.topics import Topics, base_topic
from tof_infer.config import InferConfig
from tof_infer.frames import Mark
from tof_infer.session import Session
from tof_ros import messages, qos
from tof_ros.base import LEFT_OVER
from tof_ros.managed import ManagedNode
from tof_ros.patience import PERIOD_S, Patience

if TYPE_CHECKING:
    from collections.abc import Mapping

    from tof_core.capture import Capture

NAME = "infer"
OUTPUTS = {"depth": Image, "sigma": Image, "camera_info": CameraInfo}
"""Topics under `infer/`. Where sigma is infinite the raw depth stands."""


@dataclass(frozen=True, slots=True)
class LiveConfig(ManagedOptions):
    """Parameters that only the running node has."""

    reliable: bool = param(
        False, "subscribe to the sensors with reliable QoS: no loss from a reliable publisher, no connection to a best-effort one"
    )
    patience_s: float = param(0.5, "longest wait of a frame for its amplitude", unit="s", low=0.05, high=10.0)


@dataclass(frozen=True, slots=True)
class InferNodeConfig:
    """Parameters of the node."""

    input: BagOptions = section(BagOptions, "topics, frames and units")
    infer: InferConfig = section(InferConfig, "the network")
    live: LiveConfig = section(LiveConfig, "the running node")


CONFIG = InferNodeConfig


class InferNode(ManagedNode[InferNodeConfig]):
    """Corrects each frame (docs/nodes/infer.md)."""

    def __init__(self, **options: Any) -> None:
        """Nothing loaded yet."""
        super().__init__(NAME, NAME, InferNodeConfig, fixed=("input.", "infer.", "live."), **options)
        self._kept = 0.0
        self._refusal = ""
        self._outputs = {name: self.output(name, kind) for name, kind in OUTPUTS.items()}
        self.service("flush", self.flush)

    def load(self) -> None:
        """Read the network."""
        self._session = Session(self.config.infer)

    def start(self) -> None:
        """Subscribe; topics are spot_ros2's by default, relative and remappable."""
        self._topics = _topics(self.config.input)
        self._builder = CaptureBuilder(self.config.input, None, replace(self._topics, amplitude=""), need_tf=False)
        self._builder.on_skip = lambda stamp, reason: self._skipped(stamp, reason, self._builder.last_error)
        self._patience = Patience(self.config.live.patience_s)
        self._arrivals: dict[int, float] = {}
        self._jump = BackwardJump()
        sensor = qos.sensor(reliable=self.config.live.reliable, depth=32)
        self.input(self._topics.depth, messages.image_class(self._topics.depth), self._frame, sensor, frames="input.depth_topic")
        self.input(self._topics.info, CameraInfo, self._info, sensor)
        if self._topics.amplitude:
            self.input(self._topics.amplitude, messages.image_class(self._topics.amplitude), self._amplitude, sensor)
        if self._topics.temperature:
            self.input(self._topics.temperature, Temperature, self._builder.temperature, sensor)
        self.timer(PERIOD_S, self._tick)

    def unload(self) -> None:
        """Release the network."""
        del self._session

    def _frame(self, message: Any) -> None:
        arrived = self.tally.arrived()
        if self.left_over(stamp_ns(message)):
            self.skip(stamp_ns(message), LEFT_OVER)
            return
        self._arrivals[stamp_ns(message)] = arrived
        self._patience.start(stamp_ns(message))
        self._builder.depth(message)
        if self._jump:
            self.jumped()
        self._advance()

    def _info(self, message: CameraInfo) -> None:
        self._builder.info(message)
        self._advance()

    def _amplitude(self, message: Any) -> None:
        # Seen for the first time: from now on it is waited for.
        self._builder.topics = self._topics
        self._builder.amplitude(message)
        self._advance()

    def _tick(self) -> None:
        self._builder.overdue = max(self._builder.overdue, self._patience.tick())
        self._advance()

    def _advance(self, *, final: bool = False) -> None:
        for capture in self._builder.ready(final=final):
            try:
                self._repair(capture)
            except RefusedError as error:
                self._refusal = str(error)
                self._skipped(capture.stamp_ns, "refused", str(error))
            except ToftwinError as error:
                self._skipped(capture.stamp_ns, "bad frame", str(error))

    def _repair(self, capture: Capture) -> None:
        repaired = self._session.repair(capture)
        self._refusal = ""
        self._kept = float((repaired.mark == Mark.RAW_KEPT).mean())
        head = messages.header(capture.stamp_ns, capture.camera.frame_id)
        self.offer(self._outputs["depth"], lambda: messages.image(repaired.depth, "32FC1", head))
        self.offer(self._outputs["sigma"], lambda: messages.image(repaired.sigma, "32FC1", head))
        self._outputs["camera_info"].publish(messages.camera_info(capture.camera, head))
        self._patience.end(capture.stamp_ns)
        self._jump.clear()
        self.done(capture.stamp_ns, self._arrivals.pop(capture.stamp_ns, time.monotonic()))

    def _skipped(self, stamp: int, reason: str, why: str) -> None:
        self._patience.end(stamp)
        self._arrivals.pop(stamp, None)
        self.skip(stamp, reason, why)
        if reason == LATE:
            self._jump.late(stamp, self._builder.last_stamp)

    def reset(self) -> str:
        """Discard the frames that are waiting."""
        self._builder.reset()
        self.forget_frames(self._arrivals)
        self._patience.clear()
        self._jump.clear()
        return "what waited is forgotten"

    def flush(self) -> str:
        """Give out every frame that waits, as at the end of a bag."""
        waiting = self._builder.waiting
        self._advance(final=True)
        return f"{waiting} frames waited"

    def figures(self) -> Mapping[str, str]:
        """The network, and the share of the last frame that kept its raw depth."""
        return {"model": self._session.path.name, "device": self._session.device, "kept_raw": f"{self._kept:.3f}"}

    def warnings(self) -> list[str]:
        """A network that refuses this camera, or keeps the raw depth in most of the image."""
        out = [self._refusal] if self._refusal else []
        if self._kept > 0.5:
            out.append(f"the network does not know {self._kept:.0%} of the last frame: is it this camera's, and this range's?")
        return out


def _topics(options: BagOptions) -> Topics:
    depth = options.depth_topic or "depth/hand/image"
    return Topics(
        depth=depth,
        points="",
        info=options.info_topic or f"{base_topic(depth).rpartition('/')[0]}/camera_info",
        amplitude=_wanted(options.amplitude_topic, "ir/hand/image"),
        temperature=_wanted(options.temperature_topic, "hand/temperature"),
    )


def _wanted(name: str, default: str) -> str:
    return "" if name == NOT_WANTED else name or default


def make_node(**options: Any) -> InferNode:
    """The node; keyword arguments as of `rclpy.node.Node`."""
    return InferNode(**options)
