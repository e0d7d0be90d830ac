# SPDX-License-Identifier: Apache-2.0
"""Captures that separate effects: the action in words, the camera's pose, and other changes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from tof_core import se3

if TYPE_CHECKING:
    from collections.abc import Callable

    from tof_core.arrays import Float
    from tof_sensor.frame import Frame


@dataclass(frozen=True, slots=True)
class Action:
    """An additional capture.

    text: the instruction; pose: maps `T_cell_camera` (4, 4) and the view's median range in metres to the pose of the new capture; change:
    what differs in the frame besides the pose.
    """

    text: str
    pose: Callable[[Float, float], Float]
    change: Callable[[Frame], Frame]


def _same_pose(T: Float, _: float) -> Float:
    return T


def _along(factor: float) -> Callable[[Float, float], Float]:
    def pose(T: Float, range_m: float) -> Float:
        step = np.eye(4)
        step[2, 3] = (1 - factor) * range_m
        return np.asarray(T @ step)

    return pose


def _around(angle_deg: float) -> Callable[[Float, float], Float]:
    def pose(T: Float, range_m: float) -> Float:
        out, back = np.eye(4), np.eye(4)
        out[2, 3], back[2, 3] = range_m, -range_m
        return np.asarray(T @ out @ se3.exp([0, 0, 0, 0, np.radians(angle_deg), 0]) @ back)

    return pose


def _unchanged(frame: Frame) -> Frame:
    return frame


def _brighter(frame: Frame) -> Frame:
    return replace(frame, amplitude=4.0 * frame.amplitude)


def _warmer(frame: Frame) -> Frame:
    return replace(
        frame, context=replace(frame.context, temperature=frame.context.temperature + 15.0, time_s=frame.context.time_s + 1800.0)
    )


BRIGHTER = Action("capture the same poses again with four times the exposure", _same_pose, _brighter)
NEARER = Action("capture from 0.6 times the distance", _along(0.6), _unchanged)
FARTHER = Action("capture from 1.6 times the distance", _along(1.6), _unchanged)
ASIDE = Action("capture from 35 degrees to the side", _around(35.0), _unchanged)
LATER = Action("capture the same poses again half an hour later, warm", _same_pose, _warmer)
