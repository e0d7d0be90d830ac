# SPDX-License-Identifier: Apache-2.0
"""Depth images that a driver has registered to another camera, such as the colour camera of the same hand.

A driver moves each point of the depth camera to a pixel of the other camera, to the nearest whole one, and keeps the nearest of several
points. So depth on a slope is off by up to half of its step from pixel to pixel, an error that neighbours share. Where the other camera
has more pixels, points are copied to several of them, and the nearest of these copies make the slope too near; or no point falls on some of
them, which are holes in lines one pixel wide.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tof_core.registered_holes import holed
from tof_core.shares import in_percent
from tof_core.topics import is_registered

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Image

COPIES = 0.05
"""Least share of neighbours with exactly the same depth in an image of copies. Of depth without codes noise alone makes none, and of depth in codes
0.006 have the same amplitude besides; holes filled by a neighbour make 0.10 to 0.13, points copied to two by two pixels 0.35."""
CHANCE = 0.25
"""Largest share of neighbours of other depth that have the same amplitude by rounding, with which copies are distinguished from chance. Of an
amplitude of 16 bits 0.08 and less."""
WIDE_PX = 5
"""Pixels that no point is copied to side by side: equal depths over as many are a surface square to the camera, without noise, as a simulator has it."""
CODED = 0.5
"""Least share of depths in whole millimetres from which depth is written in codes: neighbours then have the same one by rounding."""
WHAT = "On slopes depth is off by up to half of its step from pixel to pixel, and too near where pixels are copies"
REMEDY = "record the depth camera's own image with its camera_info"


def registered(depths: Sequence[Image], topic: str, amplitudes: Sequence[Image | None] = ()) -> str:
    """Why a depth image counts as registered to another camera, in words; empty if it does not.

    depths: (H, W) metres, NaN without depth, of some frames or means of dwells; topic: its name, empty where depth has none; amplitudes:
    (H, W) of the same frames, without which copies of depth in codes are not known.
    """
    if topic and is_registered(topic):
        return f"By the name of its topic, {topic}, depth is registered to another camera"
    light = amplitudes or [None] * len(depths)
    share = float(np.median([copied(z, a) for z, a in zip(depths, light, strict=True)])) if depths else 0.0
    if share >= COPIES:
        return f"Depth is registered to another camera: {in_percent(share)} of neighbouring pixels are copies of each other"
    share = holed([np.isfinite(z) for z in depths])
    return f"Depth is registered to another camera: {in_percent(share)} of the pixels are holes in lines one pixel wide" if share else ""


def copied(depth: Image, amplitude: Image | None = None) -> float:
    """Share of the neighbours along rows of which one is a copy of the other.

    Of depth (H, W) in codes, those that have the same amplitude, too; 0 where it is not known, or in coarse codes itself.
    """
    one, other, far = depth[:, :-WIDE_PX], depth[:, 1 : 1 - WIDE_PX], depth[:, WIDE_PX:]
    seen = np.isfinite(one) & np.isfinite(other) & np.isfinite(far)
    copies = (one == other) & (one != far) & seen
    if not copies.any():  # As in nearly every image of depth without codes: whether there are codes need not be looked at.
        return 0.0
    mm = 1e3 * depth[np.isfinite(depth)].astype(np.float64)
    if float(np.mean(np.abs(mm - np.rint(mm)) < 1e-3)) >= CODED:
        if amplitude is None:
            return 0.0
        alike, apart = amplitude[:, :-WIDE_PX] == amplitude[:, 1 : 1 - WIDE_PX], seen & (one != other)
        chance = float(alike[apart].mean()) if apart.any() else 0.0
        if chance > CHANCE:
            return 0.0
        both, of_depth = int((copies & alike).sum()), int(copies.sum())
        return max(both - chance * of_depth, 0.0) / (1.0 - chance) / float(seen.sum())
    return float(copies.sum() / seen.sum())
