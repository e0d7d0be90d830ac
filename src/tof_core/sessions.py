# SPDX-License-Identifier: Apache-2.0
"""Sessions of a recording: between two of them the clock was set back (a driver restarted, a bag played in a loop)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tof_core.errors import BagError
from tof_core.jump import JUMP_FRAMES, JUMP_NS

if TYPE_CHECKING:
    from pathlib import Path

    from tof_core.arrays import Ints

ONE_SET_BACK_NS = JUMP_NS
"""Jumps of several topics within this log time are one jump; two jumps are further apart, each being of more than `JUMP_NS`."""


def set_back(stamps: Ints) -> list[int]:
    """Indices at which stamps (N,), in the order of the log, were set back: `JUMP_FRAMES` ascending stamps, all more than `JUMP_NS` too old."""
    found: list[int] = []
    start = 0
    while True:
        newest = np.maximum.accumulate(stamps[start:])
        late = np.zeros(len(newest), bool)
        late[1:] = stamps[start + 1 :] < newest[:-1] - JUMP_NS
        rising = np.ones(len(newest), bool)
        rising[1:] = np.diff(stamps[start:]) > 0
        runs = late[: len(late) - JUMP_FRAMES + 1].copy()
        for k in range(1, JUMP_FRAMES):
            runs &= late[k : len(runs) + k] & rising[k : len(runs) + k]
        if not runs.any():
            return found
        start += int(np.argmax(runs))
        found.append(start)


def session_starts(topics: Ints, stamps: Ints, logs: Ints, counted: set[int]) -> list[int]:
    """Log times, ascending, at which at least half of the counted topics show that the clock was set back.

    Args:
        topics: (N,) topic number of each message, in the order of the log.
        stamps: (N,) header stamps in nanoseconds, 0 where there is none.
        logs: (N,) log times in nanoseconds.
        counted: numbers of the topics that count: images, clouds and CameraInfos.
    """
    times: list[tuple[int, int]] = []
    voters = 0
    for number in counted:
        mine = np.flatnonzero((topics == number) & (stamps > 0))
        if len(mine) >= JUMP_FRAMES:
            voters += 1
            times += [(int(logs[mine[i]]), number) for i in set_back(stamps[mine])]
    starts: list[int] = []
    group: list[tuple[int, int]] = []
    for time in [*sorted(times), (2**62, -1)]:
        if group and time[0] - group[0][0] > ONE_SET_BACK_NS:
            if 2 * len({number for _, number in group}) >= voters:
                starts.append(group[0][0])
            group = []
        group.append(time)
    return starts


def chosen(sizes: list[int], wanted: int, where: Path | str) -> int:
    """Index of the session to read: `wanted` counts from 1, 0 is the longest.

    Raises:
        BagError: there is no such session.
    """
    if wanted > len(sizes):
        todo = f"--session 1 to {len(sizes)}, or without the flag the longest"
        raise BagError(f"has {len(sizes)} {'sessions' if len(sizes) > 1 else 'session'}, no session {wanted}", where=where, todo=todo)
    return wanted - 1 if wanted else int(np.argmax(sizes))
