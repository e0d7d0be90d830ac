# SPDX-License-Identifier: Apache-2.0
"""What only a running `gap` has: its parameters."""

from __future__ import annotations

from dataclasses import dataclass

from tof_core.config import section
from tof_core.live import ViewOptions
from tof_gap.watch import WatchConfig


@dataclass(frozen=True, slots=True)
class GapNodeConfig:
    """Parameters of the node."""

    watch: WatchConfig = section(WatchConfig, "when a growing gap is reported")
    live: ViewOptions = section(ViewOptions, "the running node")
