# SPDX-License-Identifier: Apache-2.0
"""The bias of an effect that moves the camera or changes its lens, by rendering: first order fails at millimetres of shift."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import maximum_filter, minimum_filter

from tof_scene.render import render

if TYPE_CHECKING:
    from tof_align.chain import Chain
    from tof_core.arrays import Float, Mask
    from tof_gap.seen.evidence.view import ViewEvidence
    from tof_scene.raycast import Raycaster
    from tof_scene.rendering import Rendering
    from tof_sensor.effect import Effect


def rendered_bias(effect: Effect, view: ViewEvidence, v: int, chain: Chain, caster: Raycaster, other_surface_m: float) -> Float:
    """(H, W) metres that an effect adds to view `v` of a chain; rendered where the effect moves the camera or changes its lens.

    To first order only at pixels where another surface comes into view beside an edge: half a pixel decides there.
    """
    linear, stated, mount = effect.bias(view.frame), view.view.camera, effect.mount
    camera = effect.camera(stated)
    if mount is not None:
        chain = replace(chain, hand_eye=mount)
    elif camera == stated:
        return linear
    there = render(caster, camera, chain.pose(v), footprints=False)
    exact = there.depth * effect.published(stated) - view.frame.depth
    near_by = (there.part == view.rendering.part) & (np.abs(exact - linear) < other_surface_m)
    return np.where(near_by | _inside(there, other_surface_m), exact, linear)


def _inside(there: Rendering, step_m: float) -> Mask:
    """(H, W) pixels around which one part is seen without a step in depth, which an inclined surface does not have: no edge is near."""
    one = minimum_filter(there.part, 2 * BESIDE_PX + 1) == maximum_filter(there.part, 2 * BESIDE_PX + 1)
    z = np.pad(there.depth, BESIDE_PX, mode="edge")
    middle, two = slice(BESIDE_PX, -BESIDE_PX), 2 * BESIDE_PX
    across, down = z[middle, two:] + z[middle, :-two], z[two:, middle] + z[:-two, middle]
    bend = np.maximum(np.abs(across - 2 * there.depth), np.abs(down - 2 * there.depth))
    return np.asarray(one & (there.part >= 0) & (bend < step_m))


BESIDE_PX = 2
"""Pixels to either side of an edge: poses and lenses of a solution are known to a pixel, and footprints reach half a pixel further."""
