# SPDX-License-Identifier: Apache-2.0
"""What a healthy camera errs by: hand-eye and lens within their stated calibration, and effects below a tolerance."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tof_align.folds import deal
from tof_core.stats import touched
from tof_gap.solve.candidate import HAND_EYE
from tof_gap.solve.columns import ColumnStore
from tof_sensor.effects.depth_scale import DepthScale
from tof_sensor.effects.intrinsics import Intrinsics

if TYPE_CHECKING:
    from tof_core.arrays import Float
    from tof_core.calibration import Calibration
    from tof_core.camera import Camera
    from tof_gap.solve.solution import Joint
    from tof_gap.solved import Named


def calibrated(one: Named, stated: Calibration, camera: Camera) -> bool:
    """Whether a named effect is hand-eye, lens, or scale before a printed board, and no farther off than the calibration states."""
    if one.name == HAND_EYE:
        return _mounted_as_stated(one, stated)
    if one.name == DepthScale.NAME:
        return _no_longer(one.effects[0].coefficients, np.array([*one.std[0].values()]), 1e-2 * stated.board.print_scale_pct)
    return one.name == Intrinsics.NAME and _seen_as_stated(one, stated, camera)


def below(joint: Joint, least_m: float) -> set[str]:
    """Names of effects, and observables of free functions, all of whose members are smaller than `least_m` as `size_m` measures them."""
    design, fit = joint.design, joint.selection.fit
    store = ColumnStore(joint.views, deal(joint.chain.station.tolist(), FOLDS))
    largest = dict[str, float]()
    for candidate, group, at in design.placed(joint.selection.chosen.members):
        name = candidate.note if candidate.free is not None else candidate.name
        scale = design.scale[group]
        columns = np.concatenate(store.of([candidate])[0])
        size = size_m(columns, fit.theta[at] / scale, fit.theta_cov[at, at] / np.outer(scale, scale)) if len(group) else np.inf
        largest[name] = max(size, largest.get(name, 0.0))
    return {name for name, size in largest.items() if size < least_m}


FOLDS = 6
"""Parts of the views; the lines of a fixed pattern come from the other parts."""


def size_m(columns: Float, values: Float, cov: Float) -> float:
    """Metres of z: RMS of the map `columns` (n, k) @ `values` (k,) over the pixels that it affects, less the map's own variance.

    `cov` (k, k) is the values' covariance: what noise alone would give a map is no size.
    """
    values_of = columns @ values
    affected = touched(values_of)
    if not affected.any():
        return 0.0
    C = columns[affected]
    mean2 = float(np.mean(values_of[affected] ** 2 - np.einsum("nk,kl,nl->n", C, cov, C)))
    return float(np.sqrt(max(mean2, 0.0)))


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
