# SPDX-License-Identifier: Apache-2.0
"""Parts that stand elsewhere: something of their size is measured beside their place in the CAD.

Either views look through that place, or the session's solution finds the part to stand off: a shelf that stands higher hides its place.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Float, Mask
    from tof_scene.scene import Scene
    from tof_scene.world.foreign import Foreign
    from tof_scene.world.limits import WorldLimits
    from tof_scene.world.seen import Seen

LOOKED_THROUGH = 0.1
"""Share of a part's measured pixels that lie behind it, from which a part of its place is empty: an object before it does not do that."""
REACH_M = 0.08
"""Farthest that a part is taken to have moved."""
INSIDE = 0.7
"""Share of an object's points that must lie within that reach of the part's box."""
LARGER = 1.3
"""Diagonal of the object over that of the part, up to which it may be the part."""
AS_LARGE = 0.7
"""Diagonal of the object over that of the part, from which it is all of the part: of a large part, what is measured before the CAD is most of it."""
TURNED = 2.0
"""Ratio of what all of a part stands off the CAD in the median to what the solution finds: a part that is turned stands off by more here than there."""
OFF = 0.3
"""Share of a part's stand-off by which an object's distance to the CAD may differ from it: the solution knows it to a tenth or two."""
LEAST_PX = 30
"""Measured pixels of a part, over all views, from which it is judged."""


@dataclass(frozen=True, slots=True, eq=False)
class Elsewhere:
    """The box of a part that does not stand in its place: lowest and highest corner (3,).

    off_m: how far it stands off by the session's solution, metres; 0 where that is not known, and views look through its place.
    """

    bottom: Float
    top: Float
    off_m: float = 0.0

    def may_be(self, found: Foreign, limits: WorldLimits) -> bool:
        """Whether an object may be this part, moved by less than `REACH_M`; where it is known how far, the object stands off the CAD by that."""
        low, high = np.quantile(found.points, [0.02, 0.98], axis=0)
        size = float(np.linalg.norm(high - low) / np.linalg.norm(self.top - self.bottom))
        near = ((found.points > self.bottom - REACH_M) & (found.points < self.top + REACH_M)).all(axis=1)
        if size >= LARGER or near.mean() <= INSIDE:
            return False
        if not self.off_m or (size > AS_LARGE and 1.0 / TURNED < float(np.median(found.clearance)) / self.off_m < TURNED):
            return True
        alike = near & (np.abs(found.clearance - self.off_m) < OFF * self.off_m + 1e-3 * limits.least_mm)
        return bool(self.off_m > 1e-3 * limits.stands_out_mm and alike.mean() > INSIDE)


def parts_elsewhere(views: Sequence[Seen], behind: Sequence[Mask], scene: Scene, limits: WorldLimits) -> list[Elsewhere]:
    """Parts through whose place some of the views look, and parts that the session's solution finds to stand off their CAD."""
    every, empty, off = np.zeros((3, len(scene.parts)))
    for seen, far in zip(views, behind, strict=True):
        on = (seen.part >= 0) & np.isfinite(seen.depth)
        every += np.bincount(seen.part[on], minlength=len(every))
        empty += np.bincount(seen.part[on & far], minlength=len(every))
        if seen.apart is not None:
            np.maximum.at(off, seen.part[on], seen.apart[on])
    seen_through = (every >= LEAST_PX) & (empty > LOOKED_THROUGH * every)
    stands_off = (every >= LEAST_PX) & (off > 1e-3 * limits.least_mm)
    boxes = [(p.vertices.min(axis=0), p.vertices.max(axis=0)) for p in scene.parts]
    return [
        *(Elsewhere(*boxes[k]) for k in np.flatnonzero(seen_through)),
        *(Elsewhere(*boxes[k], float(off[k])) for k in np.flatnonzero(stands_off & ~seen_through)),
    ]
