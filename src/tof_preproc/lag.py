# SPDX-License-Identifier: Apache-2.0
"""Whether the images and TF move together: the time between a motion in TF and the same motion in the depth.

Where the clock of the camera differs from that of the robot, or a driver stamps late, frames in motion count as still and get a wrong
pose. The depth changes from frame to frame while the camera moves, and TF states the camera's velocity: the shift at which both agree
best is the difference of their clocks. At least half a frame is visible; `toftwin gap` finds less from a bag (`time_sync`).
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from tof_core.arrays import Float, Image

FRAMES = 600
"""Frames that are compared: forty seconds at 15 Hz, some stops and drives."""
EVERY = 30
"""Frames between two comparisons, which take as long as a frame's filters."""
PIXELS = 2000
"""Pixels of a frame that are compared, on a raster: their median change is known to a fortieth of the noise."""
MOTIONS = 4
"""Starts and stops in TF below which nothing is stated: one may be a part that moves, or a person."""
LONGEST_S = 1.0
"""Largest difference that is looked for: stops are longer."""
AGREEMENT = 0.7
"""Least correlation at the best shift: motion that TF does not know, or depth without texture, has less."""
BETTER = 0.15
"""By how much it must exceed that without a shift: noise of a correlation over some stops is 0.05."""
LEVER_M = 1.0
"""Distance at which a turn of the camera counts as a motion of the surface."""
QUIET = 0.2
"""Quantile of the changes that a camera at rest has: it rests for a fifth of the time, at least."""


@dataclass(frozen=True, slots=True)
class Lag:
    """The depth follows TF by so many seconds (negative: TF follows the depth); motions: starts and stops that show it."""

    seconds: float
    motions: int

    def __str__(self) -> str:
        """In one line, with what to do."""
        which = "after" if self.seconds > 0 else "before"
        about = max(round(abs(self.seconds), 1), 0.1)  # one digit, so that the line stays the same and is logged once
        return (
            f"the depth changes about {about:.1f} s {which} TF does, at starts and stops: images and TF are stamped by clocks that differ, "
            "and poses near a drive are wrong; synchronise the clocks, or correct the driver's stamps"
        )


class LagMonitor:
    """Compares the changes of depth with the camera's velocity by TF, over the last `FRAMES` frames."""

    def __init__(self) -> None:
        """No frame yet."""
        self._before: tuple[int, Image] | None = None
        self._changes: deque[tuple[float, float]] = deque(maxlen=FRAMES)
        self._speeds: deque[tuple[float, float]] = deque(maxlen=FRAMES)
        self._found: Lag | None = None
        self._frames = 0

    def reset(self) -> None:
        """Forget all frames."""
        self._before = self._found = None
        self._changes.clear()
        self._speeds.clear()

    def push(self, stamp_ns: int, depth: Image, twist: Float | None) -> None:
        """Take a frame: depth (H, W), metres, NaN or 0 where invalid; twist (6,): velocity by TF, m/s and rad/s, None if unknown."""
        every = max(1, int(np.sqrt(depth.size / PIXELS)))
        few = depth[::every, ::every]
        if self._before is not None and self._before[1].shape == few.shape and stamp_ns > self._before[0]:
            change = np.abs(few - self._before[1])[(few > 0) & (self._before[1] > 0)]
            if len(change):
                self._changes.append((0.5e-9 * (stamp_ns + self._before[0]), float(np.median(change))))
        self._before = stamp_ns, few.copy()
        if twist is not None:
            self._speeds.append((1e-9 * stamp_ns, float(np.linalg.norm(twist[:3]) + LEVER_M * np.linalg.norm(twist[3:]))))
        self._frames += 1
        if self._frames % EVERY == 0:
            self._found = self._compared()

    def lag(self) -> Lag | None:
        """The difference, if starts and stops show one of half a frame or more; as of the last comparison."""
        return self._found

    def _compared(self) -> Lag | None:
        if min(len(self._changes), len(self._speeds)) < 2 * MOTIONS:
            return None
        (at, change), (times, speed) = np.array(self._changes).T, np.array(self._speeds).T
        step = 0.5 * float(np.median(np.diff(times)))
        grid = np.arange(max(at[0], times[0]), min(at[-1], times[-1]), step)
        reach = int(np.ceil(LONGEST_S / step))
        if len(grid) < 4 * reach:
            return None
        moves, shifts = _moving(np.interp(grid, times, speed)), _moving(np.interp(grid, at, change))
        motions = int((np.diff(moves > 0.5) != 0).sum())
        if motions < MOTIONS:
            return None
        scores = np.array([_correlation(moves, shifts, k) for k in range(-reach, reach + 1)])
        best = int(np.argmax(scores))
        if scores[best] < AGREEMENT or scores[best] < scores[reach] + BETTER or abs(best - reach) <= 1:
            return None
        return Lag(step * (best - reach + _between(scores, best)), motions)


def _moving(values: Float) -> Float:
    """0 at rest to 1 in motion: values above the quiet ones, over those of a usual motion."""
    quiet = np.quantile(values, QUIET)
    above = np.maximum(values - quiet, 0.0)
    usual = float(np.quantile(above, 1.0 - QUIET / 2))
    return np.asarray(np.minimum(above / max(usual, 1e-9), 1.0))


def _correlation(first: Float, second: Float, shift: int) -> float:
    """Of both with the second one moved back by `shift` samples."""
    n = len(first) - abs(shift)
    a, b = first[max(-shift, 0) :][:n], second[max(shift, 0) :][:n]
    if a.std() < 1e-9 or b.std() < 1e-9:
        return 0.0
    return float(np.corrcoef(a, b)[0, 1])


def _between(scores: Float, best: int) -> float:
    """Place of the maximum beside the best sample, by the parabola through its neighbours."""
    if not 0 < best < len(scores) - 1:
        return 0.0
    low, top, high = scores[best - 1 : best + 2]
    curve = low - 2.0 * top + high
    return float(0.5 * (low - high) / curve) if curve < 0 else 0.0
