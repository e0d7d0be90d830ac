# SPDX-License-Identifier: Apache-2.0
"""Whether the base stands still (stations) and whether the camera stands still (motion gate), both from TF."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tof_core import se3
from tof_core.config import param
from tof_core.errors import TransformError

if TYPE_CHECKING:
    from tof_core.arrays import Float
    from tof_core.tf import TransformBuffer


@dataclass(frozen=True, slots=True)
class StationConfig:
    """Apparent motion of the base within one station."""

    tolerance_mm: float = param(8.0, "the base has moved if its origin moved by more than this", unit="mm", low=0.1, high=1000.0)
    tolerance_deg: float = param(0.5, "the base has moved if it turned by more than this", unit="deg", low=0.01, high=90.0)


class StationTracker:
    """Numbers the stations: intervals in which the base stands still in the cell.

    The reference is the station's first pose, so a slow drift cannot carry a station away.
    """

    def __init__(self, config: StationConfig | None = None) -> None:
        """No station yet."""
        self._config = config or StationConfig()
        self._first: Float | None = None
        self._station = -1

    def push(self, T_cell_body: Float) -> int:
        """The station (0, 1, ...) of the next capture, with the body at `T_cell_body`."""
        if self._first is None or self._moved(self._first, T_cell_body):
            self._first = T_cell_body
            self._station += 1
        return self._station

    def _moved(self, first: Float, T_cell_body: Float) -> bool:
        metres, degrees = se3.distance(first, T_cell_body)
        return metres * 1e3 > self._config.tolerance_mm or degrees > self._config.tolerance_deg

    def reset(self) -> None:
        """Begin at station 0 again."""
        self._first, self._station = None, -1


@dataclass(frozen=True, slots=True)
class MotionConfig:
    """The motion gate: how fast the camera may move while a capture counts as still."""

    window_s: float = param(
        0.04, "interval before and after the capture's stamp over which TF gives the speed", unit="s", low=0.005, high=1.0
    )
    speed_mm_s: float = param(10.0, "a faster camera counts as moving", unit="mm/s", low=0.01, high=10000.0)
    turn_deg_s: float = param(1.0, "a camera that turns faster counts as moving", unit="deg/s", low=0.001, high=1000.0)


UNEVEN = 0.5
"""Change of velocity within the window, as a share of the larger one, from which a camera speeds up or slows down, or TF errs."""


def camera_velocity(transforms: TransformBuffer, cell: str, camera: str, stamp_ns: int, window_s: float) -> Float | None:
    """(6,) mean velocity of the camera over stamp ± window in its own axes (m/s, rad/s), or None where TF has no data.

    Where TF covers only one side of the stamp (live, the later side is still missing), that side counts.
    """
    return camera_motion(transforms, cell, camera, stamp_ns, window_s)[0]


def camera_motion(transforms: TransformBuffer, cell: str, camera: str, stamp_ns: int, window_s: float) -> tuple[Float | None, bool]:
    """`camera_velocity`, and whether the velocity changes by `UNEVEN` or more between both sides of the stamp; False for one side."""
    half = round(window_s * 1e9)
    ends = [T for s in (stamp_ns - half, stamp_ns, stamp_ns + half) if (T := _pose(transforms, cell, camera, s)) is not None]
    if len(ends) < 2:
        return None, False
    velocity = np.asarray(se3.log(se3.inverse(ends[0]) @ ends[-1]) / (window_s * (len(ends) - 1)))
    if len(ends) < 3:
        return velocity, False
    before, after = (se3.log(se3.inverse(a) @ b) for a, b in itertools.pairwise(ends))  # A point 1 m away turns as far as it is carried.
    return velocity, bool(np.linalg.norm(after - before) > UNEVEN * max(np.linalg.norm(before), np.linalg.norm(after)))


def _pose(transforms: TransformBuffer, cell: str, camera: str, stamp_ns: int) -> Float | None:
    try:
        return transforms.lookup(cell, camera, stamp_ns)
    except TransformError:
        return None


def is_still(
    transforms: TransformBuffer,
    cell: str,
    camera: str,
    stamp_ns: int,
    config: MotionConfig | None = None,
) -> bool:
    """Whether the camera stands still in the cell around a stamp; False where TF has no data."""
    config = config or MotionConfig()
    return is_slow(camera_velocity(transforms, cell, camera, stamp_ns, config.window_s), config)


def is_slow(velocity: Float | None, config: MotionConfig) -> bool:
    """Whether a camera's velocity (6,), as of `camera_velocity`, counts as standing still; False where it is not known."""
    if velocity is None:
        return False
    speed, turn = np.linalg.norm(velocity[:3]), np.degrees(np.linalg.norm(velocity[3:]))
    return bool(1e3 * speed <= config.speed_mm_s and turn <= config.turn_deg_s)
