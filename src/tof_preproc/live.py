# SPDX-License-Identifier: Apache-2.0
"""Parameters and topic names of the running node `preproc`."""

from __future__ import annotations

from dataclasses import dataclass

from tof_core.config import param, section
from tof_core.live import depth_code
from tof_core.options import NOT_WANTED, BagOptions
from tof_core.topics import Topics, base_topic
from tof_preproc.stream_config import StreamConfig


@dataclass(frozen=True, slots=True)
class LiveConfig:
    """Parameters that only the running node has."""

    reliable: bool = param(
        False, "subscribe to the sensors with reliable QoS: no loss from a reliable publisher, no connection to a best-effort one"
    )
    need_tf: bool = param(True, "skip frames without a transform; false accumulates them as if nothing moved")
    patience_s: float = param(1.0, "longest wait of a frame for its transform and amplitude", unit="s", low=0.2, high=60.0)
    view_every: int = param(
        1,
        "captures of a dwell from one published view to the next; the last view is always published; 0: the last view alone, at half the processor time, once the dwell has ended or after preproc.motion.max_gap_s without a frame",
        low=0,
        high=256,
    )
    keep_tf_s: float = param(30.0, "length of the TF history that is kept", unit="s", low=1.0, high=3600.0)
    record: str = param("", "folder in which ~/start_recording writes a bag of the raw topics, those of the colour camera and TF too")
    depth_code: str = depth_code()


@dataclass(frozen=True, slots=True)
class PreprocNodeConfig(StreamConfig):
    """Parameters of the node."""

    live: LiveConfig = section(LiveConfig, "the running node")


def input_topics(options: BagOptions) -> Topics:
    """Topics to subscribe to: the given names, else spot_ros2's. They are relative, so that namespaces and remappings apply."""
    cloud = bool(options.points_topic) and not options.depth_topic
    depth = "" if cloud else options.depth_topic or "depth/hand/image"
    return Topics(
        depth=depth,
        points=options.points_topic if cloud else "",
        info=options.info_topic or f"{base_topic(depth or options.points_topic).rpartition('/')[0]}/camera_info",
        amplitude=_wanted(options.amplitude_topic, "ir/hand/image"),
        temperature=_wanted(options.temperature_topic, "hand/temperature"),
    )


def colour_topics(options: BagOptions) -> tuple[str, str]:
    """Image and calibration of the colour camera, which preproc records beside the depth and does not use; empty where not wanted."""
    image = _wanted(options.colour_topic, "camera/hand/image")
    return image, options.colour_info_topic or (f"{base_topic(image).rpartition('/')[0]}/camera_info" if image else "")


def _wanted(name: str, default: str) -> str:
    return "" if name == NOT_WANTED else name or default
