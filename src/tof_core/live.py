# SPDX-License-Identifier: Apache-2.0
"""What running nodes share without ROS: their options, and a view put together from the messages of `preproc`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from tof_core.capture import View
from tof_core.config import param
from tof_core.decode import camera_from_info, pixels
from tof_core.robot import RobotChain
from tof_core.tf import TransformBuffer

if TYPE_CHECKING:
    from collections.abc import Mapping

    from tof_core.placement import Placement


@dataclass(frozen=True, slots=True)
class ManagedOptions:
    """Of a node that is configured and activated before it works."""

    autostart: bool = param(True, "configure and activate at the start; false waits for a lifecycle manager")


@dataclass(frozen=True, slots=True)
class ViewOptions(ManagedOptions):
    """Of a node that takes the views of `preproc` to the CAD."""

    scene: str = param("", "scene.yaml of the cell, its folder, or a built-in scene's name")
    cell_frame: str = param("", "TF frame of the cell; empty: the scene's")
    body_frame: str = param("", "TF frame of the robot's base; empty: 'body' or 'base_link' on the way")
    max_gap_s: float = param(0.2, "longest pause of TF that is interpolated", unit="s", low=0.001, high=10.0)
    patience_s: float = param(1.0, "a view waits so long for its transform", unit="s", low=0.2, high=60.0)
    keep_tf_s: float = param(30.0, "history of TF", unit="s", low=1.0, high=3600.0)

    def chain(self, cell: str = "", placed: Placement | None = None) -> RobotChain:
        """Frames and transforms, nothing heard yet; `cell` holds where the options name none."""
        transforms = TransformBuffer(self.max_gap_s, keep_s=self.keep_tf_s)
        return RobotChain(transforms, self.cell_frame or cell, self.body_frame, placed)


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
