# SPDX-License-Identifier: Apache-2.0
"""Curved surfaces in a camera that averages over neighbours: the mean of a window lies off the surface at its centre."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterator

    from tof_core.arrays import Float, Mask
    from tof_scene.rendering import Rendering

AVERAGED_M, STEP_M = 0.005, 0.05
"""Metres by which two opposite neighbours together may differ from twice the pixel's range where any filter averages over them, and from
which none does: filters stop at steps of some millimetres to a few centimetres."""


def averaging_error(rendering: Rendering, ray_length: Float, window_px: int) -> tuple[Float, Mask]:
    """What an average over `window_px` x `window_px` pixels of one part adds to the depth of its CAD.

    Depth is too long on convex surfaces and too short in concave ones: by half of the curvature times the mean square distance to the
    centre, for a window of any form. Neighbours are taken in pairs opposite each other, so that a slope adds nothing at the rim of a part;
    pairs across a step are left out.

    Args:
        rendering: the CAD.
        ray_length: (H, W) range along the ray over z.
        window_px: width of the window (`NoiseCorrelation.window_px`).

    Returns:
        (H, W) metres of z, 0 where nothing was rendered; and (H, W) the pixels beside creases and small steps of their part, of which it
        is not known whether the filter averages over them.
    """
    along = rendering.depth * ray_length
    height, width = along.shape
    total, weights, doubtful = np.zeros(along.shape), np.ones(along.shape), np.zeros(along.shape, np.bool_)
    for down, right, weight in _pairs(window_px):
        reach = abs(right)
        inside = np.s_[down : height - down, reach : width - reach]
        ahead, behind = (np.s_[down + s * down : height - down + s * down, reach + s * right : width - reach + s * right] for s in (1, -1))
        bend = along[ahead] + along[behind] - 2.0 * along[inside]
        alike = (rendering.part[ahead] == rendering.part[inside]) & (rendering.part[behind] == rendering.part[inside])
        taken = alike & (np.abs(bend) < AVERAGED_M)  # false where one is not rendered
        doubtful[inside] |= alike & (np.abs(bend) >= AVERAGED_M) & (np.abs(bend) < STEP_M)
        total[inside] += np.where(taken, weight * bend, 0.0)
        weights[inside] += 2.0 * weight * taken
    return np.asarray(total / weights / ray_length), doubtful


def _pairs(window_px: int) -> Iterator[tuple[int, int, float]]:
    """Rows down, columns right and weight of one neighbour of each pair; the outermost pixels of an even window count half."""
    reach = window_px // 2
    of = np.ones(2 * reach + 1)
    if window_px % 2 == 0:
        of[[0, -1]] = 0.5
    for down in range(reach + 1):
        for right in range(-reach, reach + 1):
            if down > 0 or right > 0:
                yield down, right, float(of[reach + down] * of[reach + right])
