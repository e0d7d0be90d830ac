# SPDX-License-Identifier: Apache-2.0
"""Shadows of the camera's lamp: near surfaces between the lamp and surfaces that the lens sees."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import maximum_filter

from tof_core.stats import squares

if TYPE_CHECKING:
    from tof_core.arrays import Float, Mask
    from tof_core.camera import Camera

BLOCK_PX = 4
"""Side of the blocks of pixels in which shadows are computed, coarse since thousands of lost pixels are judged."""


def shadowed(depth: Float, camera: Camera, lamp_m: float) -> Mask:
    """(H, W) pixels that may be in the shadow of a lamp up to `lamp_m` beside the lens, on any side.

    For a lamp at distance b from the lens, a surface at depth n shadows surfaces at a larger depth z, up to f b (1 / n - 1 / z) pixels
    beside it. The last block of this distance is left out, so that a slope casts no shadow on itself.

    Args:
        depth: (H, W) metres of the CAD, NaN off it.
        camera: its focal length.
        lamp_m: farthest place of the lamp, metres.
    """
    with np.errstate(divide="ignore"):
        nearness = np.where(np.isfinite(depth) & (depth > 0), 1.0 / depth, 0.0)
    reach = nearest = squares(nearness, BLOCK_PX).max(axis=(1, 3))
    step = BLOCK_PX / (max(camera.fx, camera.fy) * lamp_m)
    least = float(nearness[nearness > 0].min(initial=np.inf))
    for _ in range(int(np.ceil(max(float(nearest.max()) - least, 0.0) / step))):
        spread = np.maximum(reach, maximum_filter(reach, 3) - step)
        if np.array_equal(spread, reach):
            break
        reach = spread
    rows, columns = (np.minimum(np.arange(n) // BLOCK_PX, m - 1) for n, m in zip(depth.shape, reach.shape, strict=True))
    return np.asarray((nearness > 0) & (reach[np.ix_(rows, columns)] > nearness + step))
