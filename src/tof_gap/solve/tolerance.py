# SPDX-License-Identifier: Apache-2.0
"""Errors of a healthy camera: hand-eye and lens within their stated calibration, and effects below a tolerance."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tof_gap.solve.hypotheses.candidate import HAND_EYE
from tof_sensor.effects.depth_scale import DepthScale
from tof_sensor.effects.intrinsics import Intrinsics

if TYPE_CHECKING:
    from tof_core.arrays import Float
    from tof_core.calibration import Calibration
    from tof_core.camera import Camera
    from tof_gap.solved import Named


def calibrated(one: Named, stated: Calibration, camera: Camera) -> bool:
    """Whether a named effect is hand-eye, lens, or scale before a printed board, and within the stated calibration."""
    if one.name == HAND_EYE:
        return _mounted_as_stated(one, stated)
    if one.name == DepthScale.NAME:
        return _no_longer(one.effects[0].coefficients, np.array([*one.std[0].values()]), 1e-2 * stated.board.print_scale_pct)
    return one.name == Intrinsics.NAME and _seen_as_stated(one, stated, camera)


def _mounted_as_stated(one: Named, stated: Calibration) -> bool:
    """Whether position and rotation of the camera are within the stated calibration, to one standard deviation."""
    values, sd = one.effects[0].coefficients, np.array([*one.std[0].values()])
    parts = zip((slice(3), slice(3, 6)), stated.hand_eye_most, strict=True)
    return all(_no_longer(values[at], sd[at], bound) for at, bound in parts)


def _no_longer(vector: Float, sd: Float, bound: float) -> bool:
    """Whether a vector's length is within a bound above 0, to one standard deviation in its direction."""
    length = float(np.linalg.norm(vector))
    return bound > 0 and length <= bound + float(np.linalg.norm(vector / max(length, 1e-12) * sd))


def _seen_as_stated(one: Named, stated: Calibration, camera: Camera) -> bool:
    """Whether a lens shifts rays by no more than the stated calibration, both in pixels RMS over the image."""
    if not stated.lens_sd.any():
        return False
    rays, there = ((c.rays()[..., :2] * (camera.fx, camera.fy)) for c in (camera, one.effects[0].camera(camera)))
    shift, radius = (float(np.sqrt(np.mean(np.sum(r**2, axis=-1)))) for r in (there - rays, rays))
    return shift <= stated.lens_most_px(radius)
