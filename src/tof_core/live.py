# SPDX-License-Identifier: Apache-2.0
"""Options common to the nodes, and views assembled from the messages of `preproc`; without ROS."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tof_core.capture import View
from tof_core.compressed import DEPTH_CODES
from tof_core.config import param
from tof_core.decode import camera_from_info, pixels, time_ns
from tof_core.errors import RefusedError
from tof_core.placement import parse_placement
from tof_core.robot import RobotChain
from tof_core.tf import TransformBuffer

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from tof_core.arrays import Float
    from tof_core.placement import Placement


def depth_code() -> str:
    """The parameter `live.depth_code` of every node that publishes depth."""
    code: str = param("png", "code of the compressedDepth topic: png is smaller, rvl is faster", choices=DEPTH_CODES)
    return code


@dataclass(frozen=True, slots=True)
class ManagedOptions:
    """Options of a managed (lifecycle) node."""

    autostart: bool = param(True, "configure and activate at the start; false waits for a lifecycle manager")
    bond_s: float = param(
        0.0,
        "period of the heartbeats of a bond to nav2's lifecycle manager while the node is active; 0: no bond",
        unit="s",
        low=0.0,
        high=1.0,
    )


@dataclass(frozen=True, slots=True)
class ViewOptions(ManagedOptions):
    """Options of a node that compares the views of `preproc` with the CAD."""

    scene: str = param("", "scene.yaml of the cell, its folder, or a built-in scene's name")
    cell_frame: str = param("", "TF frame of the cell; empty: the scene's")
    initial_pose: str = param(
        "",
        "where the cell is if TF does not know it: 'FRAME: x y z qx qy qz qw', or without FRAME in the camera's frame; the topic initialpose changes it",
    )
    body_frame: str = param("", "TF frame of the robot's base; empty: 'body' or 'base_link' on the way")
    max_gap_s: float = param(0.2, "longest gap in TF that is interpolated", unit="s", low=0.001, high=10.0)
    patience_s: float = param(1.0, "longest wait of a view for its transform", unit="s", low=0.2, high=60.0)
    keep_tf_s: float = param(30.0, "length of the TF history that is kept", unit="s", low=1.0, high=3600.0)

    @property
    def scene_name(self) -> str:
        """The scene in a word: its folder's name, or a built-in scene's."""
        path = Path(self.scene)
        return (path.parent if path.suffix in {".yaml", ".yml"} else path).name

    def placement(self) -> Placement | None:
        """The placement in `initial_pose`.

        Raises:
            UsageError: it is no pose.
        """
        return parse_placement(self.initial_pose, where="live.initial_pose")

    def chain(
        self, cell: str = "", placed: Placement | None = None, on_placed: Callable[[str, str, Float], None] | None = None
    ) -> RobotChain:
        """Frames and an empty transform buffer; `cell` is used where the options name none."""
        transforms = TransformBuffer(self.max_gap_s, keep_s=self.keep_tf_s)
        return RobotChain(transforms, self.cell_frame or cell, self.body_frame, placed, on_placed)


@dataclass(frozen=True, slots=True)
class ColourViewOptions(ViewOptions):
    """Options of a node that uses colour beside depth."""

    colour_topic: str = param("camera/hand/image", "colour image, optional; 'none' leaves it out")
    colour_info_topic: str = param("", "the colour camera's calibration; empty: beside the image")
    colour_join_s: float = param(0.5, "a view's colour is at most this much older or newer than it", unit="s", low=0.0, high=60.0)


class Dwells:
    """The newest view of each recent dwell."""

    def __init__(self, most: int) -> None:
        """No view yet."""
        self._views: deque[View] = deque(maxlen=most)

    def add(self, view: View) -> None:
        """Add a view; it replaces an earlier view of its dwell."""
        if self._views and self._views[-1].dwell_ns == view.dwell_ns:
            self._views[-1] = view  # in one step: another thread may be reading
        else:
            self._views.append(view)

    def all(self) -> tuple[View, ...]:
        """The views in order of time, at least one.

        Raises:
            RefusedError: no view has come.
        """
        views = tuple(self._views)
        if not views:
            raise RefusedError("no view has come yet", where="preproc", todo="is preproc running, and does TF reach the camera?")
        return views

    @property
    def count(self) -> int:
        """Number of dwells kept."""
        return len(self._views)

    def at(self, stamp_ns: int) -> View | None:
        """The view of a stamp, None where it is not kept."""
        return next((v for v in self._views if v.stamp_ns == stamp_ns), None)

    def clear(self) -> None:
        """Drop all views."""
        self._views.clear()


def view_of(stamp: int, parts: Mapping[str, Any], chain: RobotChain) -> View:
    """A view from the messages of `preproc`, by topic name; the dwell is in `dwell_info` or `dwell`, the robot's pose comes from TF."""
    camera = camera_from_info(parts["camera_info"], "preproc/camera_info")
    amplitude, noise = parts.get("amplitude"), parts.get("noise")
    return View(
        stamp_ns=stamp,
        camera=camera,
        robot=chain.pose(camera.frame_id, stamp),
        depth=pixels(parts["depth"]),
        sigma=pixels(parts["sigma"]),
        count=pixels(parts["count"]),
        reason=pixels(parts["reason"]),
        amplitude=None if amplitude is None else pixels(amplitude),
        noise=None if noise is None else pixels(noise),
        **(_typed(parts["dwell_info"]) if "dwell_info" in parts else _texts(parts["dwell"])),
    )


def _typed(dwell: Any) -> dict[str, Any]:
    """Fields of a view in a toftwin_msgs/Dwell."""
    return {
        "dwell_ns": time_ns(dwell.first),
        "station": int(dwell.station),
        "captures": int(dwell.captures),
        "temperature": float(dwell.temperature),
    }


def _texts(dwell: Any) -> dict[str, Any]:
    """Fields of a view in a TimeReference whose source is `station=N captures=N amplitude=N`."""
    about = dict(pair.split("=", 1) for pair in dwell.source.split())
    return {"dwell_ns": time_ns(dwell.time_ref), "station": int(about["station"]), "captures": int(about["captures"])}


def has_amplitude(dwell: Any) -> bool:
    """Whether the view of a `dwell_info` or `dwell` message has an amplitude image."""
    return bool(dwell.amplitude) if hasattr(dwell, "amplitude") else "amplitude=1" in dwell.source
