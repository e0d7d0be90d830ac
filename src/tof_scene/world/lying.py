# SPDX-License-Identifier: Apache-2.0
"""Flat objects end in a step; a part that is bent, and an error of the sensor, come back to the CAD by and by."""

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
"""Pixels at either side of an object's outline that may mix both surfaces, and the width of the rims beyond them that are compared."""
AROUND = 0.5
"""Share of the outer rim that the parts under the object must fill: what ends where a part ends may be the part's own end, bent."""
UNDER = 0.2
"""Share of the object's pixels from which on a part lies under it: an object hides a few pixels of what is behind it."""
STEP = 0.6
"""Step from the inner to the outer rim over the object's height: 1 for a slab; a bump that a smooth bend raises has a third."""
HEIGHT = 0.9
"""Quantile of the deviations on an object that is its height."""


def ends_in_a_step(seen: Seen, measured: Float, object_px: Mask, *, on_a_part: bool) -> bool:
    """Whether what pixels (H, W) measured before the CAD ends in a step all around.

    Args:
        seen: the view.
        measured: (H, W) depth without the sensor's own effects, metres.
        object_px: (H, W) the pixels.
        on_a_part: whether every part under the pixels must be in its place beside them, around most of them.
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


def most_end_in_a_step(views: Iterable[tuple[Seen, Float, Mask]], *, on_a_part: bool) -> bool:
    """Whether the object ends in a step in most of the views, each as in `ends_in_a_step`."""
    found = [ends_in_a_step(*one, on_a_part=on_a_part) for one in views]
    return sum(found) > 0.5 * len(found)
