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

COPIES = 0.1
"""Least share of neighbours with exactly the same depth in an image of copies. Of depth without codes noise alone makes none; points copied to two
by two pixels make 0.35."""
WIDE_PX = 5
"""Pixels that no point is copied to side by side: equal depths over as many are a surface square to the camera, without noise, as a simulator has it."""
CODED = 0.5
"""Least share of depths in whole millimetres from which depth is written in codes: neighbours then have the same one by rounding."""
WHAT = "On slopes depth is off by up to half of its step from pixel to pixel, and too near where pixels are copies"
REMEDY = "record the depth camera's own image with its camera_info"


def registered(depths: Sequence[Image], topic: str) -> str:
    """Why a depth image counts as registered to another camera, in words; empty if it does not.

    depths: (H, W) metres, NaN without depth, of some frames or means of dwells; topic: its name, empty where depth has none.
    """
    if topic and is_registered(topic):
        return f"By the name of its topic, {topic}, depth is registered to another camera"
    share = float(np.median([copied(z) for z in depths])) if depths else 0.0
    if share >= COPIES:
        return f"Depth is registered to another camera: {in_percent(share)} of neighbouring pixels are copies of each other"
    share = holed([np.isfinite(z) for z in depths])
    return f"Depth is registered to another camera: {in_percent(share)} of the pixels are holes in lines one pixel wide" if share else ""


def copied(depth: Image) -> float:
    """Share of the neighbours along rows of which one is a copy of the other, 0 where depth (H, W) is written in codes."""
    one, other, far = depth[:, :-WIDE_PX], depth[:, 1 : 1 - WIDE_PX], depth[:, WIDE_PX:]
    seen = np.isfinite(one) & np.isfinite(other) & np.isfinite(far)
    copies = (one == other) & (one != far) & seen
    if not copies.any():  # As in nearly every image of depth without codes: whether there are codes need not be looked at.
        return 0.0
    mm = 1e3 * depth[np.isfinite(depth)].astype(np.float64)
    coded = float(np.mean(np.abs(mm - np.rint(mm)) < 1e-3)) >= CODED
    return 0.0 if coded else float(copies.sum() / seen.sum())
