# SPDX-License-Identifier: Apache-2.0
"""Pose of the cell for a robot whose TF lacks the cell frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tof_core import se3
from tof_core.errors import UsageError

if TYPE_CHECKING:
    from tof_core.arrays import Float


@dataclass(frozen=True, slots=True, eq=False)
class Placement:
    """A first guess of the cell's pose in a frame of TF (`odom`, `vision`; an empty name: the camera's frame).

    `T_frame_cell` (4, 4) maps points of the cell into `frame`. It is used only where TF does not connect cell and camera.
    """

    frame: str
    T_frame_cell: Float

    def __post_init__(self) -> None:
        """Refuse a matrix that is no rigid motion."""
        object.__setattr__(self, "T_frame_cell", se3.as_se3(f"placement in {self.frame}", self.T_frame_cell))


def parse_placement(text: str, camera_frame: str = "", where: str = "--initial-pose") -> Placement | None:
    """`x y z qx qy qz qw` (metres, quaternion) in the camera's frame, or `FRAME: x y z qx qy qz qw`; None where the text is empty.

    Raises:
        UsageError: any other text; the error names `where`.
    """
    if not text.strip():
        return None
    frame, colon, numbers = text.rpartition(":")
    try:
        values = [float(v) for v in numbers.replace(",", " ").split()]
    except ValueError:
        values = []
    if len(values) not in (3, 7) or not np.isfinite(values).all():
        todo = "for instance '0 0 0.8 0 0 0 1', or 'odom: 1 0 0 0 0 0 1'"
        raise UsageError(f"'{text}' is not 'x y z qx qy qz qw'", where=where, todo=todo)
    return Placement(frame.strip() if colon else camera_frame, se3.from_quat(values[:3], values[3:] or (0, 0, 0, 1)))


def is_planar(T: Float) -> bool:
    """Whether a pose (4, 4) has no height and no tilt, as a pose drawn on a map."""
    return bool(T[2, 3] == 0 and T[2, 2] > 1 - 1e-9)


def moved_in_plane(T: Float, before: Float) -> Float:
    """The pose (4, 4) `before` with the place and heading of `T`; height and tilt are kept."""
    turn = np.arctan2(T[1, 0], T[0, 0]) - np.arctan2(before[1, 0], before[0, 0])
    c, s = np.cos(turn), np.sin(turn)
    out = before.copy()
    out[:3, :3] = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ before[:3, :3]
    out[:2, 3] = T[:2, 3]
    return out
