# SPDX-License-Identifier: Apache-2.0
"""The nearest neighbours of pixels within a window of the raster, `LANES` pixels at a time.

The k-th distance is bracketed by counting instead of sorted out: every loop runs over the pixels side by side without a branch.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numba import njit

from tof_preproc.tiles import reach2

if TYPE_CHECKING:
    from tof_core.arrays import Image, Ints

LANES = 64
"""Pixels that are worked on together."""
STEPS = 6
"""Secant steps to the k-th distance."""
DECISIVE = 2.0
"""Radius, in multiples of the limit, of the search for the k nearest that decides whether their mean is below the limit: points spread
evenly within 1.5 limits have the limit as their mean."""
WITHIN, BEYOND, UNDECIDED = 0, 1, 2
"""Whether a pixel's mean distance is below its limit, at least that, or not known."""


@njit(cache=True, fastmath=True, error_model="numpy")
def inside(cloud: Image, pitch: float, k: int, radius: int, pad: int, pixels: Ints, rest: Ints, out: Image) -> None:
    """Fill `out` for those of the pixels (flat indices) named by `rest` whose window holds the k nearest."""
    d2 = np.empty(((2 * radius + 1) ** 2, LANES), np.float32)
    reach2, mean, lo, n_lo = (
        np.empty(LANES, np.float32),
        np.empty(LANES, np.float32),
        np.empty(LANES, np.float32),
        np.empty(LANES, np.float32),
    )
    n_hi, guess, n, total = (
        np.empty(LANES, np.float32),
        np.empty(LANES, np.float32),
        np.empty(LANES, np.float32),
        np.empty(LANES, np.float32),
    )
    width = cloud.shape[2] - 2 * pad
    for start in range(0, rest.size, LANES):
        lanes = min(LANES, rest.size - start)
        for c in range(lanes):
            p = pixels[rest[start + c]]
            reach2[c] = _window(cloud, p // width + pad, p % width + pad, radius, pitch, c, d2)
        for c in range(lanes, LANES):
            reach2[c] = reach2[0]
            for r in range(d2.shape[0]):
                d2[r, c] = d2[r, 0]
        _select(d2, k, reach2, mean, lo, n_lo, n_hi, guess, n, total)
        for c in range(lanes):
            out[rest[start + c]] = mean[c]


@njit(cache=True, fastmath=True, error_model="numpy")
def judge(cloud: Image, pitch: float, k: int, radius: int, pad: int, pixels: Ints, rest: Ints, limit: Image, verdict: Ints) -> None:
    """Compare the mean distances of those of the pixels (flat indices) named by `rest` with their limits, where a window suffices."""
    d2 = np.empty(((2 * radius + 1) ** 2, LANES), np.float32)
    reach, hi, mean, lo = np.empty(LANES, np.float32), np.empty(LANES, np.float32), np.empty(LANES, np.float32), np.empty(LANES, np.float32)
    n_lo, n_hi, guess = np.empty(LANES, np.float32), np.empty(LANES, np.float32), np.empty(LANES, np.float32)
    n, total = np.empty(LANES, np.float32), np.empty(LANES, np.float32)
    width = cloud.shape[2] - 2 * pad
    for start in range(0, rest.size, LANES):
        lanes = min(LANES, rest.size - start)
        for c in range(lanes):
            p = pixels[rest[start + c]]
            reach[c] = _window(cloud, p // width + pad, p % width + pad, radius, pitch, c, d2)
            far = np.float32(DECISIVE) * limit[rest[start + c]]
            hi[c] = max(reach[c], far * far)
        for c in range(lanes, LANES):
            reach[c], hi[c] = reach[0], hi[0]
            for r in range(d2.shape[0]):
                d2[r, c] = d2[r, 0]
        _select(d2, k, hi, mean, lo, n_lo, n_hi, guess, n, total)
        _count(d2, reach, n_hi)
        _sums(d2, reach, reach, n, total)
        for c in range(lanes):
            i, bound = rest[start + c], limit[rest[start + c]]
            least = mean[c] if n_hi[c] >= k else (n[c] + (k - n_hi[c]) * np.sqrt(reach[c])) / k
            if np.float32(0.0) <= mean[c] < bound:
                verdict[i] = WITHIN
            elif least >= bound:
                verdict[i] = BEYOND


@njit(cache=True, fastmath=True)
def _window(cloud: Image, v: int, u: int, radius: int, pitch: float, lane: int, d2: Image) -> np.float32:
    """Squared distances d2[:, lane] of a pixel to all pixels of its window, and below which no others can be."""
    x, y, z = cloud[0, v, u], cloud[1, v, u], cloud[2, v, u]
    o = 0
    for row in range(v - radius, v + radius + 1):
        for column in range(u - radius, u + radius + 1):
            dx, dy, dz = cloud[0, row, column] - x, cloud[1, row, column] - y, cloud[2, row, column] - z
            d2[o, lane] = dx * dx + dy * dy + dz * dz
            o += 1
    nearer: np.float32 = reach2(x, y, z, pitch, radius)
    return nearer


@njit(cache=True, fastmath=True)
def _select(d2: Image, k: int, hi: Image, mean: Image, lo: Image, n_lo: Image, n_hi: Image, at: Image, n: Image, total: Image) -> None:
    """`mean` root of the k least d2 of each lane, or -1 where fewer than k lie within `hi` or the k-th is not pinned down.

    The k-th least is bracketed by counting, all lanes at once. Points of a surface lie evenly over its area, so their
    number grows linearly with d2, and a secant finds the k-th in a few steps. The roots between the last brackets
    are counted by their mean. (Separate arrays, not rows of one: so the compiler sees that they do not overlap.)
    """
    lo[:], n_lo[:] = np.float32(0.0), np.float32(1.0)
    _count(d2, hi, n_hi)
    for _ in range(STEPS):
        _secant(lo, hi, n_lo, n_hi, at, np.float32(k))
        _count(d2, at, n)
        _bracket(lo, hi, n_lo, n_hi, at, n, np.float32(k))
    _sums(d2, lo, hi, n, total)
    for c in range(LANES):
        share = (k - n_lo[c]) / np.maximum(n_hi[c] - n_lo[c], np.float32(1.0))
        found = n_hi[c] >= k and (n_hi[c] - n_lo[c] <= np.float32(3.0) or hi[c] - lo[c] <= np.float32(0.1) * hi[c])
        mean[c] = (n[c] + share * total[c]) / k if found else np.float32(-1.0)


@njit(cache=True, fastmath=True)
def _secant(lo: Image, hi: Image, n_lo: Image, n_hi: Image, at: Image, k: float) -> None:
    for c in range(LANES):
        part = (k - np.float32(0.5) - n_lo[c]) / np.maximum(n_hi[c] - n_lo[c], np.float32(1.0))
        part = np.minimum(np.maximum(part, np.float32(0.05)), np.float32(0.95))
        at[c] = lo[c] + (hi[c] - lo[c]) * part


@njit(cache=True, fastmath=True)
def _bracket(lo: Image, hi: Image, n_lo: Image, n_hi: Image, at: Image, n: Image, k: float) -> None:
    for c in range(LANES):
        below = n[c] < k
        lo[c] = at[c] if below else lo[c]
        n_lo[c] = n[c] if below else n_lo[c]
        hi[c] = hi[c] if below else at[c]
        n_hi[c] = n_hi[c] if below else n[c]


@njit(cache=True, fastmath=True)
def _count(d2: Image, limit: Image, n: Image) -> None:
    n[:] = np.float32(0.0)
    for o in range(d2.shape[0]):
        row = d2[o]
        for c in range(LANES):
            n[c] += np.float32(1.0) if row[c] <= limit[c] else np.float32(0.0)


@njit(cache=True, fastmath=True)
def _sums(d2: Image, lo: Image, hi: Image, below: Image, between: Image) -> None:
    """Sums of roots up to lo, and from there up to hi."""
    below[:], between[:] = np.float32(0.0), np.float32(0.0)
    for o in range(d2.shape[0]):
        row = d2[o]
        for c in range(LANES):
            root = np.sqrt(row[c])
            below[c] += root if row[c] <= lo[c] else np.float32(0.0)
            between[c] += root if lo[c] < row[c] <= hi[c] else np.float32(0.0)
