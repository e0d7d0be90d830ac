# SPDX-License-Identifier: Apache-2.0
"""Displaced parts: an object of a part's size is measured beside the part's place in the CAD.

Evidence is that views measure surfaces behind that place, or that the session's solution has the part off its CAD: a raised shelf hides its place.
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
"""Share of a part's pixels measured behind it, from which a part of its place is empty; an object before the part causes no such pixels."""
REACH_M = 0.08
"""Largest displacement of a part, metres."""
INSIDE = 0.7
"""Share of an object's points that must lie within `REACH_M` of the part's box."""
LARGER = 1.3
"""Largest ratio of the object's diagonal to the part's."""
AS_LARGE = 0.7
"""Ratio of the object's diagonal to the part's from which the object is the whole part; of a large part, most is measured before the CAD."""
TURNED = 2.0
"""Largest ratio of an object's median distance from the CAD to the part's in the solution, and inverse: a rotated part has different distances."""
OFF = 0.3
"""Share of the part's distance from its CAD by which an object's distance may differ: the solution's is accurate to 10 or 20 %."""
LEAST_PX = 30
"""Fewest measured pixels of a part, over all views."""


@dataclass(frozen=True, slots=True, eq=False)
class Elsewhere:
    """The box of a displaced part in the CAD: lowest and highest corner (3,).

    off_m: distance from the CAD by the session's solution, metres; 0 if unknown, with views that measure surfaces behind its place.
    """

    bottom: Float
    top: Float
    off_m: float = 0.0

    def may_be(self, found: Foreign, limits: WorldLimits) -> bool:
        """Whether an object may be this part, displaced by less than `REACH_M`, and by `off_m` if that is known."""
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
    """Parts with surfaces behind them in the views, and parts off their CAD by the session's solution."""
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
