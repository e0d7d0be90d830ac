# SPDX-License-Identifier: Apache-2.0
"""Settings from messages to views; apart from the stream itself, so that they are printed without its kernels."""

from __future__ import annotations

from dataclasses import dataclass

from tof_core.config import section
from tof_core.motion import MotionConfig, StationConfig
from tof_core.options import BagOptions
from tof_preproc.config import PreprocConfig


@dataclass(frozen=True, slots=True)
class StreamConfig:
    """From messages to views. The names are the same in YAML files, ROS parameters and the documentation."""

    input: BagOptions = section(BagOptions, "topics, frames and units")
    still: MotionConfig = section(MotionConfig, "when the camera counts as still")
    station: StationConfig = section(StationConfig, "when the base counts as still")
    preproc: PreprocConfig = section(PreprocConfig, "accumulation and filters")
