# SPDX-License-Identifier: Apache-2.0
"""Parameters of the running node `sim_label`."""

from __future__ import annotations

from dataclasses import dataclass

from tof_core.config import param, section
from tof_core.live import ViewOptions, depth_code
from tof_sim_label.labeller import LabellerConfig


@dataclass(frozen=True, slots=True)
class LiveConfig(ViewOptions):
    """Parameters that only the running node has."""

    settle_s: float = param(
        2.5, "time without another view after which a view is labelled; 0: when the next dwell begins", unit="s", low=0.0, high=3600.0
    )
    share: float = param(
        0.0,
        "largest share of a core for labels, which are then made in a thread of their own; a dwell that ends while the share is used up gets no label, and is counted; 0: every dwell gets its label, and views wait for it",
        low=0.0,
        high=1.0,
    )
    publish_tf: bool = param(True, "publish the cell's frame (latched) if TF lacks it, and CAMERA_aligned of each accepted view")
    sensor: str = param("", "sensor.yaml of the camera: its effects are removed before poses are solved; empty: nothing is known")
    record: str = param("", "folder in which ~/start_recording writes a bag of the labels and TF")
    depth_code: str = depth_code()


@dataclass(frozen=True, slots=True)
class LabelNodeConfig(LabellerConfig):
    """Parameters of the node."""

    live: LiveConfig = section(LiveConfig, "the running node")
