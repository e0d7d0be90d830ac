# SPDX-License-Identifier: Apache-2.0
"""Parameters of the node `sensor`, without ROS."""

from __future__ import annotations

from dataclasses import dataclass

from tof_core.config import param, section
from tof_core.live import ManagedOptions, depth_code
from tof_core.options import NOT_WANTED, BagOptions
from tof_core.topics import Topics, base_topic
from tof_sensor.simulator import SimulatorConfig


@dataclass(frozen=True, slots=True)
class LiveConfig(ManagedOptions):
    """Parameters that only the running node has."""

    scene: str = param(
        "", "scene.yaml of the cell, its folder, or a built-in scene's name; it provides part, albedo, normals and mixed pixels"
    )
    normals_topic: str = param("", "images of unit normals (32FC3, camera's optical frame); empty: computed from the depth")
    reliable: bool = param(
        True, "subscribe to the simulator with reliable QoS: no loss from a reliable publisher, no connection to a best-effort one"
    )
    patience_s: float = param(0.5, "longest wait of a frame for its albedo, normals or transform", unit="s", low=0.05, high=10.0)
    keep_tf_s: float = param(30.0, "length of the TF history that is kept", unit="s", low=1.0, high=3600.0)
    depth_code: str = depth_code()


@dataclass(frozen=True, slots=True)
class SensorNodeConfig:
    """Parameters of the node."""

    input: BagOptions = section(BagOptions, "topics of the simulator, frames and units")
    sensor: SimulatorConfig = section(SimulatorConfig, "the simulated camera")
    live: LiveConfig = section(LiveConfig, "the running node")


def input_topics(options: BagOptions) -> Topics:
    """Topics of the simulator: by default, Gazebo's names under `sim/`."""
    depth = options.depth_topic or "sim/depth/image"
    amplitude = "" if options.amplitude_topic == NOT_WANTED else options.amplitude_topic or "sim/ir/image"
    temperature = "" if options.temperature_topic == NOT_WANTED else options.temperature_topic or "sim/temperature"
    info = options.info_topic or f"{base_topic(depth).rpartition('/')[0]}/camera_info"
    return Topics(depth=depth, info=info, amplitude=amplitude, temperature=temperature)
