# SPDX-License-Identifier: Apache-2.0
"""Registration to the CAD instead of a reference view: the sensor's bias does not cancel, but no reference is needed."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from arm_correction.register import Registration
from arm_correction.unknown import Unknown, smallest_motion
from tof_align.config import AlignConfig
from tof_align.single import align_view
from tof_core import se3

if TYPE_CHECKING:
    from tof_core.arrays import Float
    from tof_core.capture import View
    from tof_scene.raycast import Raycaster


def register_to_cad(
    view: View, caster: Raycaster, T_cell_wanted: Float, T_cell_believed: Float, *, base_mm: float = 50.0, base_deg: float = 2.0
) -> Registration:
    """Camera pose in the frame of the wanted camera pose, by aligning the view to the CAD.

    Args:
        view: depth.
        caster: the CAD.
        T_cell_wanted: (4, 4) the wanted pose of the camera (of the reference by CAD, or taught).
        T_cell_believed: (4, 4) the robot's own pose.
        base_mm: one standard deviation of that pose per axis.
        base_deg: the same of its rotation.
    """
    config = AlignConfig()
    config = replace(config, weights=replace(config.weights, pixels=4000))
    prior = np.diag(np.repeat([base_mm * 1e-3, np.radians(base_deg)], 3) ** 2)
    found = align_view(view, caster, T_cell_believed, prior, config)
    T, seen, verdict = found.posed.T_cell_camera, found.observability, found.verdict
    null = _in_camera(found.posed.null, T)
    motion = se3.inverse(T_cell_wanted) @ T
    moved = smallest_motion(motion, null) if len(null) else motion
    return Registration(
        moved,
        found.posed.cov_right,
        Unknown(null, seen.names),
        verdict.accepted,
        verdict.reason,
        verdict.fit.pixels,
        1.0,
        verdict.fit.support,
        verdict.fit.rms,
        verdict.fit.score,
        far=False,
        by="cad",
    )


def _in_camera(null: Float, T_cell_camera: Float) -> Float:
    """Undetermined directions (k, 6), from the cell's axes to the camera's axes (about the camera's origin)."""
    R = T_cell_camera[:3, :3]
    return np.concatenate([null[:, :3] @ R, null[:, 3:] @ R], axis=1) if len(null) else np.zeros((0, 6))
