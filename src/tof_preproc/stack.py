# SPDX-License-Identifier: Apache-2.0
"""The captures of a dwell, kept in sorted order, so that quantiles over time need no sorting at each new capture."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numba import njit

if TYPE_CHECKING:
    from tof_core.arrays import Bytes, Image, Ints


class Stack:
    """Up to `room` captures of one raster.

    With P = H W pixels: `ordered` (P, room) holds each pixel's depths in ascending order, `count` (H, W) how many;
    `reasons` (room, P) why a capture has none; `times` (room, P) the depths in order of time, kept only when asked for.
    """

    def __init__(self, shape: tuple[int, int], room: int, *, in_time: bool) -> None:
        """Empty; memory is allocated page by page as captures arrive."""
        self.ordered: Image = np.empty((shape[0] * shape[1], room), np.float32)
        self.count: Ints = np.zeros(shape, np.uint16)
        self.reasons: Bytes = np.empty((room, shape[0] * shape[1]), np.uint8)
        self.times: Image = np.empty((room if in_time else 0, shape[0] * shape[1]), np.float32)
        self.captures = 0

    def add(self, depth: Image, reason: Bytes) -> None:
        """One more capture, NaN where it has no depth."""
        _insert(self.ordered, self.count.ravel(), depth.ravel())
        self.reasons[self.captures] = reason.ravel()
        if len(self.times):
            self.times[self.captures] = depth.ravel()
        self.captures += 1

    def nearest(self) -> Image:
        """(H, W) each pixel's least depth, NaN where no capture has one."""
        return np.where(self.count > 0, self.ordered[:, 0].reshape(self.count.shape), np.float32(np.nan))


@njit(cache=True)
def _insert(ordered: Image, count: Ints, depth: Image) -> None:
    for p in range(depth.size):
        z = depth[p]
        if np.isnan(z):
            continue
        j = np.int64(count[p])
        count[p] += 1
        while j > 0 and ordered[p, j - 1] > z:
            ordered[p, j] = ordered[p, j - 1]
            j -= 1
        ordered[p, j] = z
