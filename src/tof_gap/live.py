# SPDX-License-Identifier: Apache-2.0
"""What only a running `gap` has: its parameters."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from tof_align.config import AlignConfig
from tof_core.config import from_mapping, param, section
from tof_core.live import ViewOptions
from tof_core.yamlio import load_yaml
from tof_gap.config import GapConfig
from tof_gap.watch import WatchConfig


@dataclass(frozen=True, slots=True)
class LiveConfig(ViewOptions):
    """Parameters that only the running node has."""

    views: int = param(60, "number of last dwells that a diagnosis uses; each takes 15 bytes a pixel", low=2, high=1000)
    sensor: str = param("", "sensor.yaml with effects that are known already: ~/diagnose removes them first; empty: nothing is known")
    red_mm: float = param(
        5.0, "gap of a part that gap/markers draws red; half of it is orange, none is green", unit="mm", low=0.1, high=1000.0
    )
    settings: str = param(
        "", "YAML file with settings gap.* and align.* of ~/diagnose, named as `toftwin gap --settings` lists them; empty: the defaults"
    )


@dataclass(frozen=True, slots=True)
class DiagnosisConfig:
    """Settings of a diagnosis on request."""

    gap: GapConfig = section(GapConfig, "when an effect is believed")
    align: AlignConfig = section(AlignConfig, "pose of the camera")

    @classmethod
    def load(cls, path: str) -> DiagnosisConfig:
        """Defaults, overlaid by a YAML file where one is named.

        Raises:
            ConfigError: unknown keys or bad values.
        """
        return from_mapping(cls, load_yaml(Path(path)), where=path) if path else cls()


@dataclass(frozen=True, slots=True)
class GapNodeConfig:
    """Parameters of the node."""

    watch: WatchConfig = section(WatchConfig, "when a growing gap is reported")
    live: LiveConfig = section(LiveConfig, "the running node")
