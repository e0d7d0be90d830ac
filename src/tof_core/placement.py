# SPDX-License-Identifier: Apache-2.0
"""Where the cell stands for a robot whose TF does not know it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from tof_core import se3

if TYPE_CHECKING:
    from tof_core.arrays import Float


@dataclass(frozen=True, slots=True, eq=False)
class Placement:
    """A first guess of the cell in a frame that TF has (`odom`, `vision`, or the camera itself).

    `T_frame_cell` (4, 4) maps points of the cell into `frame`. It counts only where TF does not
    connect the cell already.
    """

    frame: str
    T_frame_cell: Float

    def __post_init__(self) -> None:
        """Refuse what is no rigid motion."""
        object.__setattr__(self, "T_frame_cell", se3.as_se3(f"placement in {self.frame}", self.T_frame_cell))
