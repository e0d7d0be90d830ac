# SPDX-License-Identifier: Apache-2.0
"""One edge of the tree of frames over time: insertion in any order, interpolation at a stamp.

A motion is seven floats (x, y, z and a unit quaternion x, y, z, w): for so few numbers,
plain Python is ten times faster than NumPy.
"""

from __future__ import annotations

import math
from array import array
from bisect import bisect_left, bisect_right
from dataclasses import dataclass, field
from typing import TypeAlias

from tof_core.errors import TransformError

Motion: TypeAlias = tuple[float, float, float, float, float, float, float]

BLOCK = 128
"""Most samples in a block: an insertion moves at most one block (8 kB); blocks are found by bisection."""


@dataclass(slots=True)
class _Block:
    """Up to `BLOCK` samples: stamps ascending, seven floats each."""

    stamps: array[int] = field(default_factory=lambda: array("q"))
    motions: array[float] = field(default_factory=lambda: array("d"))

    def put(self, stamp_ns: int, motion: Motion) -> None:
        i = len(self.stamps) if not self.stamps or stamp_ns > self.stamps[-1] else bisect_left(self.stamps, stamp_ns)
        if i < len(self.stamps) and self.stamps[i] == stamp_ns:
            self.motions[7 * i : 7 * i + 7] = array("d", motion)
        else:
            self.stamps.insert(i, stamp_ns)
            self.motions[7 * i : 7 * i] = array("d", motion)

    def split(self) -> _Block:
        """The upper half, taken out."""
        half = len(self.stamps) // 2
        upper = _Block(self.stamps[half:], self.motions[7 * half :])
        del self.stamps[half:]
        del self.motions[7 * half :]
        return upper

    def sample(self, i: int) -> Motion:
        x, y, z, qx, qy, qz, qw = self.motions[7 * i : 7 * i + 7]
        return x, y, z, qx, qy, qz, qw


class Edge:
    """`T_parent_child` over time, in blocks of ascending stamps; one sample if static."""

    __slots__ = ("_blocks", "_firsts", "parent", "static")

    def __init__(self, parent: str, *, static: bool) -> None:
        """Without samples."""
        self.parent, self.static = parent, static
        self._blocks: list[_Block] = []
        self._firsts: list[int] = []

    def put(self, stamp_ns: int, motion: Motion) -> None:
        """Insert in order; a stamp seen before is replaced. O(log n) in the number of samples."""
        if self.static or not self._blocks:
            self._blocks, self._firsts = [_Block(array("q", [stamp_ns]), array("d", motion))], [stamp_ns]
            return
        k = max(bisect_right(self._firsts, stamp_ns) - 1, 0)
        block = self._blocks[k]
        if len(block.stamps) >= BLOCK:
            upper = _Block() if k == len(self._blocks) - 1 and stamp_ns > block.stamps[-1] else block.split()
            self._blocks.insert(k + 1, upper)
            self._firsts.insert(k + 1, upper.stamps[0] if upper.stamps else stamp_ns)
            k += stamp_ns >= self._firsts[k + 1]
        self._blocks[k].put(stamp_ns, motion)
        self._firsts[k] = self._blocks[k].stamps[0]

    def __len__(self) -> int:
        """Samples kept."""
        return sum(len(block.stamps) for block in self._blocks)

    @property
    def newest(self) -> int:
        """The newest stamp in nanoseconds."""
        return self._blocks[-1].stamps[-1]

    @property
    def reached(self) -> int:
        """Stamp in nanoseconds up to which this edge is known: the second newest, since a single stamp may lie in the future by mistake."""
        last = self._blocks[-1].stamps
        if len(last) > 1:
            return last[-2]
        return self._blocks[-2].stamps[-1] if len(self._blocks) > 1 else last[-1]

    def forget_before(self, stamp_ns: int) -> None:
        """Drop blocks of which all samples are older than `stamp_ns`."""
        old = bisect_right(self._firsts, stamp_ns) - 1
        if old > 0:
            del self._blocks[:old]
            del self._firsts[:old]

    def at(self, stamp_ns: int, max_gap_ns: int) -> Motion:
        """The motion at a stamp, or a TransformError with the reason why there is none."""
        if self.static:
            return self._blocks[0].sample(0)
        k = bisect_right(self._firsts, stamp_ns) - 1
        if k < 0:
            raise TransformError(f"starts {_ms(self._firsts[0] - stamp_ns)} after the stamp {stamp_ns}")
        block = self._blocks[k]
        i = bisect_right(block.stamps, stamp_ns) - 1
        if block.stamps[i] == stamp_ns:
            return block.sample(i)
        after, j = (block, i + 1) if i + 1 < len(block.stamps) else (self._blocks[k + 1] if k + 1 < len(self._blocks) else None, 0)
        if after is None:
            raise TransformError(f"ends {_ms(stamp_ns - block.stamps[i])} before the stamp {stamp_ns}")
        t0, t1 = block.stamps[i], after.stamps[j]
        if t1 - t0 > max_gap_ns:
            raise TransformError(f"has a gap of {_ms(t1 - t0)} at the stamp {stamp_ns} (allowed: {_ms(max_gap_ns)})")
        return _interpolate(block.sample(i), after.sample(j), (stamp_ns - t0) / (t1 - t0))


def _interpolate(p: Motion, q: Motion, share: float) -> Motion:
    """Linear in translation, slerp in rotation along the shorter arc."""
    dot = p[3] * q[3] + p[4] * q[4] + p[5] * q[5] + p[6] * q[6]
    sign = -1.0 if dot < 0 else 1.0
    angle = math.acos(min(abs(dot), 1.0))
    a, b = (
        (1 - share, share) if angle < 1e-7 else (math.sin((1 - share) * angle) / math.sin(angle), math.sin(share * angle) / math.sin(angle))
    )
    r = [a * m + sign * b * n for m, n in zip(p[3:], q[3:], strict=True)]
    n = math.sqrt(sum(c * c for c in r))
    s = 1 - share
    return (s * p[0] + share * q[0], s * p[1] + share * q[1], s * p[2] + share * q[2], r[0] / n, r[1] / n, r[2] / n, r[3] / n)


def _ms(duration_ns: int) -> str:
    return f"{duration_ns / 1e6:.0f} ms"
