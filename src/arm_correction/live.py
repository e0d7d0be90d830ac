# SPDX-License-Identifier: Apache-2.0
"""Parameters of the running node `correct`, and the rules of the arm driver that it may command."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from arm_correction.config import CorrectConfig
from tof_align.config import AlignConfig
from tof_core.config import param, section
from tof_core.errors import RefusedError
from tof_core.live import ColourViewOptions

if TYPE_CHECKING:
    from arm_correction.frames import Frames

DRIVER_FRAMES = ("body", "odom", "vision")
"""Frames that spot_ros2 passes to the robot unchanged: these names, without the robot's prefix."""
DRIVER_HAND = "hand"
"""The frame that the driver moves."""


@dataclass(frozen=True, slots=True)
class LiveConfig(ColourViewOptions):
    """Parameters that only the running node has."""

    reference: str = param(
        "", "file of the reference: read if it exists, written by ~/capture_reference; empty keeps the reference in memory"
    )
    sensor: str = param("", "sensor.yaml of the camera: its effects are removed before a view is compared with the CAD; empty: none")
    frame: str = param("", "TF frame in which targets are given; empty: the body")
    hand_frame: str = param("", "TF frame that reaches the target; empty: 'hand' (or 'PREFIX/hand'), and if TF has none the camera's")
    connect: str = param("", "topic to which accepted proposals are sent, such as arm_pose_commands: the arm then moves; empty: none")


@dataclass(frozen=True, slots=True)
class CorrectNodeConfig:
    """Parameters of the node."""

    correct: CorrectConfig = section(CorrectConfig, "registration, trust and limits")
    align: AlignConfig = section(AlignConfig, "errors of the robot's pose")
    live: LiveConfig = section(LiveConfig, "the running node")


def driver_frame(frames: Frames) -> str:
    """The frame's name as spot_ros2's `arm_pose_commands` wants it: no prefix, one that the robot knows, for the hand.

    Raises:
        RefusedError: the driver would move another frame, or read the target in another frame.
    """
    frame, hand = (name.rpartition("/")[2] for name in (frames.frame, frames.hand))
    if frame not in DRIVER_FRAMES:
        raise RefusedError(
            f"the arm's driver takes targets in {', '.join(DRIVER_FRAMES)}, not in '{frames.frame}'",
            where="live.frame",
            todo="set it to one of them",
        )
    if hand != DRIVER_HAND:
        raise RefusedError(
            f"the arm's driver moves '{DRIVER_HAND}', the target is of '{frames.hand}'",
            where="live.hand_frame",
            todo="publish the hand in TF",
        )
    return frame
