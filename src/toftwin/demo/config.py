# SPDX-License-Identifier: Apache-2.0
"""Settings of the demonstration."""

from __future__ import annotations

from dataclasses import dataclass

from tof_core.config import param


@dataclass(frozen=True, slots=True)
class DemoConfig:
    """Sessions of the demonstration: the first day, the day after, and the sweep for the network."""

    scene: str = param("body_section", "built-in scene")
    width: int = param(400, "columns of the camera", unit="px", low=32, high=1000)
    height: int = param(300, "rows of the camera", unit="px", low=32, high=1000)
    views: int = param(12, "views of the session", low=1, high=200)
    stations: int = param(3, "stations of the base", low=1, high=50)
    captures: int = param(8, "captures of each view", low=1, high=100)
    effects: str = param("wiggling=1,multipath=1", "effects of the camera and their strengths")
    later_captures: int = param(4, "captures of each view on the day after", low=2, high=100)
    moved_mm: float = param(6.0, "displacement of a part on the day after", unit="mm", low=0, high=50)
    sweep_views: int = param(11, "views of the sweep on which raw, rules and network are compared", low=1, high=100)
    seed: int = param(1, "seed of everything random", low=0)
