# SPDX-License-Identifier: Apache-2.0
"""Flat objects end in a step; a part that is bent, and an error of the sensor, come back to the CAD by and by."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy import ndimage

if TYPE_CHECKING:
    from collections.abc import Iterable

    from tof_core.arrays import Float, Mask
    from tof_scene.world.seen import Seen

EIGHT = np.ones((3, 3), bool)
MIXED_PX, RIM_PX = 1, 2
"""Pixels at either side of an object's outline that may mix both surfaces, and the width of the rims beyond them that are compared."""
AROUND = 0.5
"""Share of the outer rim that the part must fill: what ends where the part ends may be the part's own end, bent."""
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
        on_a_part: whether one part must lie under the pixels, in its place around most of them.
    """
    on = seen.part[object_px]
    on = on[on >= 0]
    if not len(on):
        return False

    def grown(pixels: int) -> Mask:
        return np.asarray(ndimage.binary_dilation(object_px, EIGHT, iterations=pixels))

    def shrunk(pixels: int) -> Mask:
        return np.asarray(ndimage.binary_erosion(object_px, EIGHT, iterations=pixels))

    before = seen.cad - measured
    inner = shrunk(MIXED_PX) & ~shrunk(MIXED_PX + RIM_PX) & np.isfinite(before)
    around = grown(MIXED_PX + RIM_PX) & ~grown(MIXED_PX)
    beside = seen.part == np.bincount(on).argmax() if on_a_part else seen.part >= 0
    outer = around & beside & np.isfinite(before)
    if not inner.any() or not outer.any() or (on_a_part and outer.sum() < AROUND * around.sum()):
        return False
    step = np.median(before[inner]) - np.median(before[outer])
    return bool(step > STEP * np.nanquantile(before[object_px], HEIGHT))


def most_end_in_a_step(views: Iterable[tuple[Seen, Float, Mask]], *, on_a_part: bool) -> bool:
    """Whether the object of most views, each as `ends_in_a_step` takes it, does."""
    found = [ends_in_a_step(*one, on_a_part=on_a_part) for one in views]
    return sum(found) > 0.5 * len(found)
