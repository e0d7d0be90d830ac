# SPDX-License-Identifier: Apache-2.0
"""What only a running `sim_label` has: its parameters, and views put together from the messages of `preproc`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from tof_core.capture import View
from tof_core.config import param, section
from tof_core.decode import camera_from_info, pixels
from tof_sim_label.labeller import LabellerConfig

if TYPE_CHECKING:
    from collections.abc import Mapping

    from tof_core.robot import RobotChain


@dataclass(frozen=True, slots=True)
class LiveConfig:
    """What only a running node has."""

    scene: str = param("", "scene.yaml of the cell, or its folder")
    cell_frame: str = param("", "TF frame of the cell; empty: the scene's")
    body_frame: str = param("", "TF frame of the robot's base; empty: 'body' or 'base_link' on the way")
    max_gap_s: float = param(0.2, "longest pause of TF that is interpolated", unit="s", low=0.001, high=10.0)
    patience_s: float = param(1.0, "a view waits so long for its transform", unit="s", low=0.2, high=60.0)
    keep_tf_s: float = param(30.0, "history of TF", unit="s", low=1.0, high=3600.0)
    settle_s: float = param(
        2.5, "a view is labelled when so long no other came; 0: only when the next dwell begins", unit="s", low=0.0, high=3600.0
    )
    record: str = param("", "folder in which ~/start_recording makes a bag of the labels")


@dataclass(frozen=True, slots=True)
class LabelNodeConfig(LabellerConfig):
    """Parameters of the node."""

    live: LiveConfig = section(LiveConfig, "the running node")


def view_of(stamp: int, parts: Mapping[str, Any], chain: RobotChain) -> View:
    """The view that `preproc` published in parts; the robot's pose comes from TF."""
    camera = camera_from_info(parts["camera_info"], "preproc/camera_info")
    dwell = parts["dwell"]
    about = dict(pair.split("=", 1) for pair in dwell.source.split())
    amplitude = parts.get("amplitude")
    return View(
        stamp_ns=stamp,
        dwell_ns=int(dwell.time_ref.sec) * 1_000_000_000 + int(dwell.time_ref.nanosec),
        camera=camera,
        robot=chain.pose(camera.frame_id, stamp),
        depth=pixels(parts["depth"]),
        sigma=pixels(parts["sigma"]),
        count=pixels(parts["count"]),
        reason=pixels(parts["reason"]),
        station=int(about["station"]),
        captures=int(about["captures"]),
        amplitude=None if amplitude is None else pixels(amplitude),
    )
