# SPDX-License-Identifier: Apache-2.0
"""What a healthy camera errs by: hand-eye and lens within their stated calibration, and effects below a tolerance."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tof_core.stats import affected_rms
from tof_gap.solve.candidate import HAND_EYE
from tof_sensor.effects.intrinsics import Intrinsics

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from tof_core.arrays import Float
    from tof_core.calibration import Calibration
    from tof_core.camera import Camera
    from tof_gap.solved import Named


def calibrated(one: Named, stated: Calibration, camera: Camera) -> bool:
    """Whether a named effect is hand-eye or lens, and no farther off than the calibration states."""
    if one.name == HAND_EYE:
        return _mounted_as_stated(one, stated)
    return one.name == Intrinsics.NAME and _seen_as_stated(one, stated, camera)


def below(maps: Mapping[str, Sequence[Float]], least_m: float) -> set[str]:
    """Names of the maps, (H, W) metres per view, whose RMS over the affected pixels is below `least_m`."""
    return {name for name, by_view in maps.items() if affected_rms(np.stack(by_view)) < least_m}


def _mounted_as_stated(one: Named, stated: Calibration) -> bool:
    """Whether place and direction of the camera are off by no more than stated, to within one standard deviation."""
    values, sd = one.effects[0].coefficients, np.array([*one.std[0].values()])
    parts = zip((slice(3), slice(3, 6)), stated.hand_eye_most, strict=True)
    return all(_no_longer(values[at], sd[at], bound) for at, bound in parts)


def _no_longer(vector: Float, sd: Float, bound: float) -> bool:
    """Whether a vector is no longer than a bound above 0, to within its standard deviation along itself."""
    length = float(np.linalg.norm(vector))
    return bound > 0 and length <= bound + float(np.linalg.norm(vector / max(length, 1e-12) * sd))


def _seen_as_stated(one: Named, stated: Calibration, camera: Camera) -> bool:
    """Whether a lens shifts rays no farther than stated, both as RMS over the image, in pixels."""
    if not stated.lens_sd.any():
        return False
    rays, there = ((c.rays()[..., :2] * (camera.fx, camera.fy)) for c in (camera, one.effects[0].camera(camera)))
    shift, radius = (float(np.sqrt(np.mean(np.sum(r**2, axis=-1)))) for r in (there - rays, rays))
    return shift <= stated.lens_most_px(radius)
