# SPDX-License-Identifier: Apache-2.0
"""The robot's own estimate of its camera pose: the chain cell, body, camera from TF."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tof_core import se3
from tof_core.capture import RobotPose
from tof_core.errors import TransformError
from tof_core.motion import MotionConfig, camera_motion

if TYPE_CHECKING:
    from collections.abc import Callable

    from tof_core.arrays import Float
    from tof_core.placement import Placement
    from tof_core.tf import TransformBuffer

BODY_NAMES = ("body", "base_link")
"""Last parts of the names of frames that are taken for the robot's base; the first found counts."""


@dataclass(frozen=True, slots=True, eq=False)
class RobotChain:
    """The frames from the cell to the camera.

    Args:
        transforms: all transforms received; the placement is added to them once the cell is needed.
        cell: TF frame of the cell; empty: the root above the camera.
        body: TF frame of the base; empty: `body` or `base_link` on the chain.
        placed: pose of the cell, for a robot whose TF lacks the cell frame.
        on_placed: called with (parent, child, `T_parent_child`) when the placement is used because TF does not connect the cell with
            the camera: the cell below the frame of the placement, or that frame below a cell that another robot has placed.
    """

    transforms: TransformBuffer
    cell: str = ""
    body: str = ""
    placed: Placement | None = None
    on_placed: Callable[[str, str, Float], None] | None = None

    def pose(self, camera_frame: str, stamp_ns: int) -> RobotPose:
        """The robot's pose at a stamp.

        Raises:
            TransformError: TF lacks a frame or has a gap; nothing is assumed.
        """
        cell, body = self.resolve(camera_frame)
        twist, uneven = camera_motion(self.transforms, cell, camera_frame, stamp_ns, MotionConfig().window_s)
        if not body:
            return RobotPose(np.eye(4), self.transforms.lookup(cell, camera_frame, stamp_ns), twist, uneven=uneven)
        T_cell_body, T_body_camera = (self.transforms.lookup(a, b, stamp_ns) for a, b in ((cell, body), (body, camera_frame)))
        return RobotPose(T_cell_body, T_body_camera, twist, uneven=uneven)

    def check(self, camera_frame: str, stamp_ns: int) -> None:
        """Raise what `pose` raises at a stamp, in a fifth of its time."""
        cell, _ = self.resolve(camera_frame)
        self.transforms.check(cell, camera_frame, stamp_ns)

    def latest(self, camera_frame: str) -> RobotPose:
        """The newest pose that TF knows; errors as of `pose`."""
        cell, _ = self.resolve(camera_frame)
        return self.pose(camera_frame, self.transforms.latest(cell, camera_frame))

    def settled(self, camera_frame: str, stamp_ns: int) -> bool:
        """Whether a missing pose will stay missing: TF connects the frames and has passed the stamp.

        While TF does not connect them, a latched transform may still arrive.
        """
        try:
            cell, _ = self.resolve(camera_frame)
            return self.transforms.settled(cell, camera_frame, stamp_ns)
        except TransformError:
            return False

    def resolve(self, camera_frame: str) -> tuple[str, str]:
        """The names (cell, body) for a camera; body is empty where the chain has none."""
        cell = self._cell(camera_frame)
        chain = self.transforms.chain(cell, camera_frame)
        if self.body:
            wanted = self.body.lstrip("/")
            if wanted not in chain:
                raise TransformError(
                    f"body frame '{wanted}' is not between '{cell}' and '{camera_frame}'",
                    where="--body-frame",
                    todo=f"between them are: {', '.join(chain)}",
                )
            return cell, wanted
        found = [f for name in BODY_NAMES for f in chain[:-1] if f.rpartition("/")[2] == name and f != cell]
        return cell, found[0] if found else ""

    def _cell(self, camera_frame: str) -> str:
        cell = self.cell.lstrip("/")
        frames = self.transforms.frames()
        if not cell and not self.placed and camera_frame in frames:
            return self.transforms.root(camera_frame)
        if cell in frames and self.transforms.connected(cell, camera_frame):
            return cell
        if self.placed is not None:
            self._place(cell or "cell", camera_frame)
            return cell or "cell"
        self._received()
        if not cell:
            raise TransformError(
                f"TF does not have the camera's frame '{camera_frame}'",
                where="/tf",
                todo=f"publish the transform to it, or let the image's header name a frame of TF (TF has {', '.join(frames)})",
            )
        raise TransformError(
            f"TF does not have the cell frame '{cell}'" if cell not in frames else f"TF does not connect '{cell}' with '{camera_frame}'",
            where="/tf",
            todo=f"pass --initial-pose (where the cell is) or --cell-frame (TF has {', '.join(frames)})",
        )

    def _received(self) -> None:
        """Refuse where there is no TF at all, which any other error would hide."""
        if not self.transforms.frames():
            todo = "publish both (and record both); where nothing moves, --initial-pose in the camera's frame does without them"
            raise TransformError("no transform has come on /tf or /tf_static", where="TF", todo=todo)

    def _place(self, cell: str, camera_frame: str) -> None:
        placed = self.placed
        assert placed is not None
        frame = placed.frame.lstrip("/") or camera_frame
        if frame != camera_frame and not self.transforms.connected(frame, camera_frame):
            self._received()
            raise TransformError(
                f"the cell is placed in '{frame}', which TF does not connect with '{camera_frame}'",
                where="/tf",
                todo=f"TF has the frames: {', '.join(self.transforms.frames())}",
            )
        parent, child, T = (
            (cell, frame, se3.inverse(placed.T_frame_cell)) if self._elsewhere(cell, frame) else (frame, cell, placed.T_frame_cell)
        )
        self.transforms.add(parent, child, 0, T, static=True)
        if self.on_placed is not None:
            self.on_placed(parent, child, T)

    def _elsewhere(self, cell: str, frame: str) -> bool:
        """Whether the cell is in another robot's TF: then this robot's frame is placed below the cell, since a frame has one parent.

        Raises:
            TransformError: `frame` has a parent of its own.
        """
        frames = self.transforms.frames()
        root = self.transforms.root(frame) if frame in frames else frame
        if cell not in frames or self.transforms.root(cell) in (cell, root):
            return False  # The cell is in no TF, or placed in this tree already.
        if root != frame:
            raise TransformError(
                f"the cell '{cell}' belongs to another robot's TF, and '{frame}' has a parent",
                where="/tf",
                todo=f"place the cell in '{root}'",
            )
        return True
