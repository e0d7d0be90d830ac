# SPDX-License-Identifier: Apache-2.0
"""The bias of an effect that moves the camera or changes its lens, by rendering: first order fails at millimetres of shift."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from tof_scene.render import render

if TYPE_CHECKING:
    from tof_align.chain import Chain
    from tof_core.arrays import Float
    from tof_gap.seen.residual import ViewEvidence
    from tof_scene.raycast import Raycaster
    from tof_sensor.effect import Effect


def rendered_bias(effect: Effect, view: ViewEvidence, v: int, chain: Chain, caster: Raycaster, other_surface_m: float) -> Float:
    """(H, W) metres that an effect adds to view `v` of a chain; rendered where the effect moves the camera or changes its lens.

    At pixels where another surface comes into view, to first order only.
    """
    linear, stated, mount = effect.bias(view.frame), view.view.camera, effect.mount
    camera = effect.camera(stated)
    if mount is not None:
        chain = replace(chain, hand_eye=mount)
    elif camera == stated:
        return linear
    there = render(caster, camera, chain.pose(v), footprints=False)
    exact = there.depth * effect.published(stated) - view.frame.depth
    return np.where((there.part == view.rendering.part) & (np.abs(exact - linear) < other_surface_m), exact, linear)
