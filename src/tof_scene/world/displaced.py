# SPDX-License-Identifier: Apache-2.0
"""Parts that stand elsewhere: their place in the CAD is seen through, and something of their size is measured beside it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Float, Mask
    from tof_scene.scene import Scene
    from tof_scene.world.seen import Seen

LOOKED_THROUGH = 0.1
"""Share of a part's measured pixels that lie behind it, from which a part of its place is empty: an object before it does not do that."""
REACH_M = 0.08
"""Farthest that a part is taken to have moved."""
INSIDE = 0.7
"""Share of an object's points that must lie within that reach of the part's box."""
LARGER = 1.3
"""Diagonal of the object over that of the part, up to which it may be the part."""
LEAST_PX = 30
"""Measured pixels of a part, over all views, from which it is judged."""


def half_empty_boxes(views: Sequence[Seen], behind: Sequence[Mask], scene: Scene) -> list[tuple[Float, Float]]:
    """Lowest and highest corner (3,) of each part through whose place some of the views look."""
    every, empty = np.zeros((2, len(scene.parts)))
    for seen, far in zip(views, behind, strict=True):
        on = (seen.part >= 0) & np.isfinite(seen.depth)
        every += np.bincount(seen.part[on], minlength=len(every))
        empty += np.bincount(seen.part[on & far], minlength=len(every))
    parts = np.flatnonzero((every >= LEAST_PX) & (empty > LOOKED_THROUGH * every))
    return [(scene.parts[k].vertices.min(axis=0), scene.parts[k].vertices.max(axis=0)) for k in parts]


def is_displaced_part(points: Float, boxes: Sequence[tuple[Float, Float]]) -> bool:
    """Whether points (n, 3) of an object may be one of the parts with these boxes, moved by less than `REACH_M`."""
    low, high = np.quantile(points, [0.02, 0.98], axis=0)
    return any(
        np.linalg.norm(high - low) < LARGER * np.linalg.norm(top - bottom)
        and float(((points > bottom - REACH_M) & (points < top + REACH_M)).all(axis=1).mean()) > INSIDE
        for bottom, top in boxes
    )
