# SPDX-License-Identifier: Apache-2.0
"""What only a running `preproc` has: its parameters and the names of its topics."""

from __future__ import annotations

from dataclasses import dataclass

from tof_core.config import param, section
from tof_core.options import NOT_WANTED, BagOptions
from tof_core.topics import Topics
from tof_preproc.stream import StreamConfig


@dataclass(frozen=True, slots=True)
class LiveConfig:
    """What only a running node has."""

    reliable: bool = param(False, "hear sensors reliably: loses nothing of a reliable publisher, hears no best-effort one")
    need_tf: bool = param(True, "skip frames without a transform; false accumulates them as if nothing moved")
    patience_s: float = param(1.0, "a frame waits so long for its transform and amplitude", unit="s", low=0.2, high=60.0)
    keep_tf_s: float = param(30.0, "history of TF", unit="s", low=1.0, high=3600.0)
    record: str = param("", "folder in which ~/start_recording makes a bag of the raw topics")


@dataclass(frozen=True, slots=True)
class PreprocNodeConfig(StreamConfig):
    """Parameters of the node."""

    live: LiveConfig = section(LiveConfig, "the running node")


def input_topics(options: BagOptions) -> Topics:
    """What the node subscribes to: the names given, else spot_ros2's, relative so that a namespace or a remapping moves them."""
    cloud = bool(options.points_topic) and not options.depth_topic
    depth = "" if cloud else options.depth_topic or "depth/hand/image"
    return Topics(
        depth=depth,
        points=options.points_topic if cloud else "",
        info=options.info_topic or f"{(depth or options.points_topic).rpartition('/')[0]}/camera_info",
        amplitude=_wanted(options.amplitude_topic, "ir/hand/image"),
        temperature=_wanted(options.temperature_topic, "hand/temperature"),
    )


def _wanted(name: str, default: str) -> str:
    return "" if name == NOT_WANTED else name or default
