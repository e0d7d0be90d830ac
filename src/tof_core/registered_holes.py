# SPDX-License-Identifier: Apache-2.0
"""Holes of a depth image that a driver registered to a camera of more pixels and left unfilled.

Points of the depth camera lie a little more than one pixel apart there, so that every so many columns and rows get none: a grid of lines one
pixel wide, which follows the depth. A camera loses lines of one direction, or pixels here and there.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Mask

LEAST_SHARE = 0.03
"""Least share of the pixels that lie in holes along columns, and along rows. Depth registered to a camera of 1.08 times the focal length has 0.058
to 0.077 of either; 68 sessions that are not registered have 0.008 and less of one of the two, noise of rows and strong fixed patterns included."""


def holed(measured: Sequence[Mask]) -> float:
    """Share of pixels in holes of one pixel's width, median over images; 0 where they make no grid.

    measured: (H, W) each, whether a pixel has depth.
    """
    if not measured:
        return 0.0
    lines = [(_along_columns(~m), _along_columns(~m.T).T) for m in measured]
    least = min(float(np.median([np.mean(pair[axis]) for pair in lines])) for axis in (0, 1))
    return float(np.median([np.mean(one | other) for one, other in lines])) if least >= LEAST_SHARE else 0.0


def holes(measured: Mask) -> Mask:
    """(H, W) pixels without depth in lines of one pixel's width, and where two such lines cross."""
    lost = ~measured
    lines = _along_columns(lost) | _along_columns(lost.T).T
    near = np.pad(lines, 1)
    around = [near[1 + dy : near.shape[0] - 1 + dy, 1 + dx : near.shape[1] - 1 + dx] for dy, dx in ((-1, 0), (1, 0), (0, -1), (0, 1))]
    return np.asarray(lines | (lost & (np.sum(around, axis=0) >= 2)))


def _along_columns(lost: Mask) -> Mask:
    """(H, W) lost pixels with depth on either side in the row, that go on above and below, straight or by one pixel aside."""
    out = np.zeros_like(lost)
    narrow = lost[1:-1, 1:-1] & ~lost[1:-1, :-2] & ~lost[1:-1, 2:]
    above, below = (lost[rows, :-2] | lost[rows, 1:-1] | lost[rows, 2:] for rows in (slice(None, -2), slice(2, None)))
    out[1:-1, 1:-1] = narrow & above & below
    return out
