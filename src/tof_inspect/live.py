# SPDX-License-Identifier: Apache-2.0
"""Parameters of the running node `inspect`."""

from __future__ import annotations

from dataclasses import dataclass

from tof_align.config import AlignConfig
from tof_core.config import param, section
from tof_core.live import ColourViewOptions
from tof_inspect.config import InspectConfig


@dataclass(frozen=True, slots=True)
class LiveConfig(ColourViewOptions):
    """Parameters that only the running node has."""

    views: int = param(20, "number of recent dwells that are judged together", low=1, high=500)
    sensor: str = param(
        "", "sensor.yaml of the camera: its effects are removed from the depth before parts are judged; empty: no correction"
    )
    out: str = param("", "folder for inspection.json and inspection.html of each judgement; empty writes none")


@dataclass(frozen=True, slots=True)
class InspectNodeConfig:
    """Parameters of the node."""

    inspect: InspectConfig = section(InspectConfig, "when a part is present")
    align: AlignConfig = section(AlignConfig, "pose of the camera")
    live: LiveConfig = section(LiveConfig, "the running node")
