# SPDX-License-Identifier: Apache-2.0
"""Flat objects on a part: an object ends in a step, a bent part or a sensor error approaches the CAD gradually."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy import ndimage

from tof_scene.world.contradiction import EIGHT

if TYPE_CHECKING:
    from collections.abc import Iterable

    from tof_core.arrays import Float, Ints, Mask
    from tof_scene.world.seen import Seen

MIXED_PX, RIM_PX = 1, 2
"""Width in pixels of the zone of mixed pixels at either side of an object's outline, and of the rims beyond the zone that are compared."""
AROUND = 0.5
"""Least share of the outer rim on the parts under the object: a step at the end of a part may be the part's own bent end."""
UNDER = 0.2
"""Least share of the object's pixels on a part under it; an object hides a few pixels of other parts, too."""
STEP = 0.6
"""Least step from the inner to the outer rim, as a share of the object's height: a slab has 1, a smooth bump a third."""
HEIGHT = 0.9
"""Quantile of an object's deviations that counts as its height."""


def ends_in_a_step(seen: Seen, measured: Float, object_px: Mask, *, on_a_part: bool) -> bool:
    """Whether an object before the CAD ends in a step all around.

    Args:
        seen: the view.
        measured: (H, W) depth without the sensor's errors, metres.
        object_px: (H, W) pixels of the object.
        on_a_part: whether the parts under the object must surround most of it and be at their place there.
    """
    before = seen.cad - measured
    finite = np.isfinite(before)
    inner = _shrunk(object_px, MIXED_PX) & ~_shrunk(object_px, MIXED_PX + RIM_PX) & finite
    around = _grown(object_px, MIXED_PX + RIM_PX) & ~_grown(object_px, MIXED_PX)
    outer = around & (seen.part >= 0) & finite

    def steps(where: Mask) -> bool:
        if not (inner & where).any() or not (outer & where).any():
            return False
        step = np.median(before[inner & where]) - np.median(before[outer & where])
        return bool(step > STEP * np.nanquantile(before[object_px & where], HEIGHT))

    if not on_a_part:
        return steps(np.ones(object_px.shape, bool))
    under = _parts_under(seen, object_px)
    filled = np.count_nonzero(outer & np.isin(seen.part, under))
    return len(under) > 0 and bool(filled >= AROUND * np.count_nonzero(around)) and all(steps(seen.part == part) for part in under)


def _parts_under(seen: Seen, object_px: Mask) -> Ints:
    parts, pixels = np.unique(seen.part[object_px & (seen.part >= 0)], return_counts=True)
    return np.asarray(parts[pixels >= UNDER * pixels.sum()])


def _grown(mask: Mask, pixels: int) -> Mask:
    return np.asarray(ndimage.binary_dilation(mask, EIGHT, iterations=pixels))


def _shrunk(mask: Mask, pixels: int) -> Mask:
    return np.asarray(ndimage.binary_erosion(mask, EIGHT, iterations=pixels))


def most_end_in_a_step(views: Iterable[tuple[Seen, Float, Mask]], *, on_a_part: bool, beyond_m: float = np.inf) -> bool:
    """Whether the object ends in a step in most of the views, each as in `ends_in_a_step`, or is more than `beyond_m` before the CAD there."""
    found = [
        bool(np.nanmedian((seen.cad - measured)[object_px]) > beyond_m) or ends_in_a_step(seen, measured, object_px, on_a_part=on_a_part)
        for seen, measured, object_px in views
    ]
    return sum(found) > 0.5 * len(found)
