# SPDX-License-Identifier: Apache-2.0
"""The captures of a dwell, kept in sorted order, so that quantiles over time need no sorting at each new capture."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numba import njit

if TYPE_CHECKING:
    from tof_core.arrays import Bytes, Image

LANES = 256
"""Pixels of a block: kernels work on them side by side, and all captures of a block fit the first cache."""
MISSING = np.float32(np.inf)
"""Depth of a capture that has none: it sorts behind all others."""


class Stack:
    """Up to `room` captures of one raster.

    P = H W pixels lie in blocks of `LANES`. `ordered` (blocks, room, LANES): each pixel's depths in ascending order, `MISSING`
    after them; `count` (blocks, LANES) how many, as float32, which keeps the kernels' loops over pixels in step with the depths; `reasons` (room, P) why a capture has none; `times` (blocks, room, LANES) the
    depths in order of time, `MISSING` where there is none, kept only when asked for (else without rows).
    """

    def __init__(self, shape: tuple[int, int], room: int, *, in_time: bool) -> None:
        """Empty; memory is allocated page by page as captures arrive."""
        self.shape = shape
        pixels = shape[0] * shape[1]
        blocks = -(-pixels // LANES)
        self.ordered: Image = np.empty((blocks, room, LANES), np.float32)
        self.count: Image = np.zeros((blocks, LANES), np.float32)
        self.reasons: Bytes = np.empty((room, pixels), np.uint8)
        self.times: Image = np.empty((blocks, room if in_time else 0, LANES), np.float32)
        self.captures = 0

    def add(self, depth: Image, reason: Bytes) -> None:
        """One more capture, NaN where it has no depth."""
        _insert(self.ordered, self.count, self.times, depth.ravel(), self.captures)
        self.reasons[self.captures] = reason.ravel()
        self.captures += 1

    def nearest(self) -> Image:
        """(H, W) each pixel's least depth, NaN where no capture has one."""
        least = self.ordered[:, 0].ravel()[: self.shape[0] * self.shape[1]].reshape(self.shape)
        return np.where(least < MISSING, least, np.float32(np.nan))


@njit(cache=True)
def _insert(ordered: Image, count: Image, times: Image, depth: Image, captures: int) -> None:
    """Carry the new depths up through the sorted rows; each row keeps the lesser."""
    carried = np.empty(LANES, np.float32)
    for b in range(ordered.shape[0]):
        start = b * LANES
        width = min(LANES, depth.size - start)
        carried[width:] = MISSING
        for c in range(width):
            z = depth[start + c]
            known = z == z  # noqa: PLR0124
            carried[c] = z if known else MISSING
            count[b, c] += np.float32(1.0) if known else np.float32(0.0)
        if times.shape[1]:
            for c in range(LANES):
                times[b, captures, c] = carried[c]
        for j in range(captures):
            for c in range(LANES):
                kept, new = ordered[b, j, c], carried[c]
                ordered[b, j, c] = min(new, kept)
                carried[c] = max(kept, new)
        for c in range(LANES):
            ordered[b, captures, c] = carried[c]
