# SPDX-License-Identifier: Apache-2.0
"""Missing parts and foreign objects, found before any effect is fitted, and removed from the views.

They are no error of the sensor. Left in the views, they would look like noise, lost returns, or deviations of the CAD.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import binary_dilation

from tof_core.reasons import Reason
from tof_scene.world.seen import Seen
from tof_scene.world.surprises import ABSENT, OBJECT, Surprises, find_surprises

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Mask
    from tof_core.capture import View
    from tof_gap.limits.evidence import WorldEvidence
    from tof_gap.seen.evidence.view import ViewEvidence
    from tof_scene.raycast import Raycaster


def world_of(evidence: Sequence[ViewEvidence], caster: Raycaster, limits: WorldEvidence) -> Surprises:
    """Missing parts and foreign objects at the poses of the evidence.

    Views in motion are searched as still ones are: motion shifts edges by pixels, and none of those is a patch of an object.
    """
    return find_surprises([_seen(v, limits) for v in evidence], caster, limits.world)


def _seen(v: ViewEvidence, limits: WorldEvidence) -> Seen:
    slope = np.maximum(np.cos(np.nan_to_num(v.rendering.incidence)), limits.least_cosine)
    return Seen(
        camera=v.frame.camera,
        T_cell_camera=v.rendering.T_cell_camera,
        depth=v.view.depth,
        noise=v.sigma.astype(np.float32),
        cad=v.frame.depth.astype(np.float32),
        cad_sigma=(1e-3 * limits.pose_mm / slope).astype(np.float32),
        part=v.rendering.part,
        reason=v.view.reason,
        amplitude=v.view.amplitude,
    )


def without_world(views: Sequence[View], world: Surprises, rim_px: int) -> list[View]:
    """The views without the pixels of missing parts and foreign objects, and without the mixed pixels of a rim of `rim_px` around."""
    return [_without(view, np.isin(codes, (ABSENT, OBJECT)), rim_px) for view, codes in zip(views, world.pixels, strict=True)]


def _without(view: View, gone: Mask, rim_px: int) -> View:
    if not gone.any():
        return view
    return taken_out(view, binary_dilation(gone, np.ones((3, 3), bool), iterations=rim_px))


def taken_out(view: View, gone: Mask) -> View:
    """The view without the pixels `gone` (H, W)."""
    return replace(view, depth=np.where(gone, np.float32(np.nan), view.depth), reason=np.where(gone, np.uint8(Reason.NOT_CAD), view.reason))
