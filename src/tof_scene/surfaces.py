# SPDX-License-Identifier: Apache-2.0
"""Samples of a pixel counted per face, and faces joined to surfaces: one part, no step in depth."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numba import njit

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from tof_core.arrays import Float

    Int32 = NDArray[np.int32]
    Float32 = NDArray[np.float32]

ONE, TINY, FAR = np.float32(1.0), np.float32(1e-30), np.float32(1e30)
STEP_M = 1e-3
"""Depth step along z, in addition to the slant of the faces, that separates two surfaces of one part, metres."""
SLANT = 1.6
"""Divided by the root of the number of samples: largest difference of neighbouring samples, as a share of a face's depth range in the pixel."""


@njit(cache=True, nogil=True)
def tally(inverse: Float32, owner: Int32, drawn: Int32, count: Int32, sums: Float32, depths: Float, seen: Int32) -> tuple[int, int]:
    """Samples `count` and `depths` (sum, nearest, farthest z) of each drawn candidate; `seen` lists visible candidates, nearest first.

    Returns the numbers of visible candidates and of void samples. 1/z in `inverse` becomes z. `sums` (..., 3) is scratch.
    """
    for c in drawn:
        count[c], sums[c, 0], sums[c, 1], sums[c, 2] = 0, 0.0, FAR, 0.0
    void = 0
    for s in range(len(inverse)):
        c, z = owner[s], ONE / max(inverse[s], TINY)
        inverse[s] = z
        if c < 0:
            void += 1
        else:
            count[c] += 1
            sums[c, 0] += z
            sums[c, 1] = min(sums[c, 1], z)
            sums[c, 2] = max(sums[c, 2], z)
    found = 0
    for c in drawn:
        if count[c]:
            for k in range(3):
                depths[c, k] = sums[c, k]
            at = found
            while at > 0 and depths[seen[at - 1], 1] > depths[c, 1]:
                seen[at] = seen[at - 1]
                at -= 1
            seen[at] = c
            found += 1
    return found, void


@njit(cache=True, nogil=True)
def group_faces(
    n: int, found: int, seen: Int32, candidates: Int32, planes: Float32, part: NDArray[np.int16], depths: Float, group: Int32, marks: Float
) -> int:
    """Surface of each seen face: faces of one part whose depths in the pixel overlap or adjoin; returns the number of surfaces.

    `n` is the number of samples; `marks` (..., 3) is scratch: part, farthest z and largest depth range of each surface so far.
    """
    groups, slant = 0, SLANT / np.sqrt(n)
    for i in range(found):
        c = seen[i]
        owner, near, far, lean = part[candidates[c]], depths[c, 1], depths[c, 2], _lean(planes, c, depths[c, 1])
        g = 0
        while g < groups and not (marks[g, 0] == owner and near - marks[g, 1] <= max(STEP_M, slant * max(lean, marks[g, 2]))):
            g += 1
        if g == groups:
            marks[g, 0], marks[g, 1], marks[g, 2] = owner, far, lean
            groups += 1
        group[i] = g
        marks[g, 1], marks[g, 2] = max(marks[g, 1], far), max(marks[g, 2], lean)
    return groups


@njit(cache=True, nogil=True)
def fold(found: int, seen: Int32, planes: Float32, depths: Float) -> float:
    """Largest difference of slope, in metres of z per pixel, between the nearest visible face and another."""
    widest = 0.0
    for i in range(1, found):
        change = 0.0
        for k in (1, 2):
            one, other = seen[0], seen[i]
            at_one = (planes[one, k] + planes[one, k + 3] + planes[one, k + 6]) * depths[one, 1] ** 2
            change += abs(at_one - (planes[other, k] + planes[other, k + 3] + planes[other, k + 6]) * depths[other, 1] ** 2)
        widest = max(widest, change)
    return widest


@njit(cache=True, nogil=True, inline="always")
def _lean(planes: Float32, c: int, z: float) -> Any:
    """Extent of a face's plane along z over the whole pixel."""
    per_u, per_v = planes[c, 1] + planes[c, 4] + planes[c, 7], planes[c, 2] + planes[c, 5] + planes[c, 8]
    return (abs(per_u) + abs(per_v)) * z * z


@njit(cache=True, nogil=True)
def surface_size(g: int, found: int, seen: Int32, group: Int32, count: Int32) -> int:
    """Samples of a surface."""
    size = 0
    for i in range(found):
        if group[i] == g:
            size += count[seen[i]]
    return size


@njit(cache=True, nogil=True)
def surface_sum(g: int, found: int, seen: Int32, group: Int32, depths: Float) -> float:
    """Sum of z over a surface's samples."""
    z = 0.0
    for i in range(found):
        if group[i] == g:
            z += depths[seen[i], 0]
    return z
