# SPDX-License-Identifier: Apache-2.0
"""The node `infer`: subscribes to raw depth, publishes corrected depth and its sigma with the frame's stamp."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from sensor_msgs.msg import CameraInfo, Image, PointCloud2

from tof_core.builder import CaptureBuilder
from tof_core.config import param, section
from tof_core.live import ManagedOptions, depth_code
from tof_core.options import NOT_WANTED, BagOptions
from tof_core.shares import in_percent
from tof_core.topics import Topics, base_topic
from tof_infer.config import InferConfig
from tof_infer.frames import Mark
from tof_infer.session import Session
from tof_ros import messages
from tof_ros.captures import CaptureFeed
from tof_ros.depth_output import DepthOutput
from tof_ros.managed import ManagedNode

if TYPE_CHECKING:
    from collections.abc import Mapping

    from tof_core.capture import Capture

NAME = "infer"
OUTPUTS = {"depth": Image, "sigma": Image, "camera_info": CameraInfo, "points": PointCloud2}
"""Topics under `infer/`. Where sigma is infinite, depth is the raw depth."""

TO_FORCE = f"start with --param {NAME}.infer.force=true (ros2 run: -p infer.force:=true)"
"""How a user lets the node run a network on another camera or range."""
UNHEARD_S = 1.0
"""Seconds between corrected frames while nobody is subscribed: the period of the diagnostics."""


@dataclass(frozen=True, slots=True)
class LiveConfig(ManagedOptions):
    """Parameters that only the running node has."""

    reliable: bool = param(
        False, "subscribe to the sensors with reliable QoS: no loss from a reliable publisher, no connection to a best-effort one"
    )
    patience_s: float = param(0.5, "longest wait of a frame for its amplitude", unit="s", low=0.05, high=10.0)
    depth_code: str = depth_code()


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
        """Make the outputs; the network is loaded by `load`."""
        super().__init__(NAME, NAME, InferNodeConfig, fixed=("input.", "infer.", "live."), **options)
        self._kept, self._repaired = 0.0, float("-inf")
        self._refusal = ""
        self._outputs = {name: self.output(name, kind) for name, kind in OUTPUTS.items()}
        self._depth = DepthOutput(self, "depth", self._outputs["depth"], lambda: self.config.live.depth_code)
        self.service("flush", self.flush)

    def load(self) -> None:
        """Read the network."""
        self._session = Session(self.config.infer, to_force=TO_FORCE)

    def start(self) -> None:
        """Subscribe; topics are spot_ros2's by default, relative and remappable."""
        topics, live = _topics(self.config.input), self.config.live
        builder = CaptureBuilder(self.config.input, None, topics, need_tf=False)
        self._feed = CaptureFeed(self, builder, topics, self._repair, self._refuse, patience_s=live.patience_s, reliable=live.reliable)

    def unload(self) -> None:
        """Release the network."""
        del self._session

    def _refuse(self, why: str) -> None:
        self._refusal = why

    def _repair(self, capture: Capture) -> None:
        """Publish a corrected frame; while nobody is subscribed, one frame a second is corrected for the diagnostics."""
        self._session.check(capture)
        self._refusal = ""
        if not self._heard() and time.monotonic() - self._repaired < UNHEARD_S:
            return
        self._repaired = time.monotonic()
        repaired = self._session.repair(capture)
        self._kept = np.count_nonzero(repaired.mark == Mark.RAW_KEPT) / repaired.mark.size
        head = messages.header(capture.stamp_ns, capture.camera.frame_id)
        self._depth.offer(repaired.depth, head)
        self.offer(self._outputs["sigma"], lambda: messages.image(repaired.sigma, "32FC1", head))
        self.offer(self._outputs["camera_info"], lambda: messages.camera_info(capture.camera, head))
        camera, amplitude = capture.camera, capture.amplitude
        self.offer(self._outputs["points"], lambda: messages.points(camera.points(repaired.depth).astype(np.float32), head, amplitude))

    def _heard(self) -> bool:
        """Whether any output has a subscriber."""
        return self._depth.heard or any(output.get_subscription_count() for output in self._outputs.values())

    def reset(self) -> str:
        """Discard the frames that wait."""
        self._feed.reset()
        return "waiting frames are discarded"

    def flush(self) -> str:
        """Correct all waiting frames, as at the end of a bag."""
        return self._feed.flush()

    def figures(self) -> Mapping[str, str]:
        """The network, and the share of the last frame that kept its raw depth."""
        return {"model": self._session.path.name, "device": self._session.device, "kept_raw": f"{self._kept:.3f}"}

    def warnings(self) -> list[str]:
        """A network that refuses this camera, or keeps the raw depth in most of the image."""
        out = [self._refusal] if self._refusal else []
        if self._kept > 0.5:
            out.append(
                f"the network leaves {in_percent(self._kept)} of the last frame as measured; check that it was trained for this camera and these ranges"
            )
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
