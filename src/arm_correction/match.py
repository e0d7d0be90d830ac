# SPDX-License-Identifier: Apache-2.0
"""From a reference and a view to a matcher; lens distortion is removed from the reference once."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from arm_correction.register import Matcher, Registration, register, settle
from arm_correction.surface import Surface, surface_of
from tof_align.pixels import raster_step, view_sigma
from tof_core import se3
from tof_core.errors import RefusedError

if TYPE_CHECKING:
    from arm_correction.config import CorrectConfig
    from arm_correction.reference import Reference
    from tof_core.arrays import Float
    from tof_core.camera import Camera
    from tof_core.capture import View


def reference_surface(reference: Reference, config: CorrectConfig) -> Surface:
    """The reference's surface on a raster without distortion; made once per reference."""
    camera, depth, sigma, region = reference.camera, reference.depth, reference.sigma, reference.region
    if camera.distorted:
        camera, at = _straight(camera)
        depth, sigma, region = (
            np.where(at >= 0, a.ravel()[at], np.array(np.nan if a.dtype != bool else 0, a.dtype)) for a in (depth, sigma, region)
        )
    return surface_of(camera, np.where(region, depth, np.nan), np.asarray(sigma, float), config.register)


def _straight(camera: Camera) -> tuple[Camera, Float]:
    """The camera without distortion, and for each of its pixels the pixel of the distorted one (-1: none)."""
    plain = replace(camera, distortion=())
    uv = camera.project(plain.rays())
    col, row = np.floor(uv[..., 0] + 0.5), np.floor(uv[..., 1] + 0.5)
    inside = (col >= 0) & (col < camera.width) & (row >= 0) & (row < camera.height)
    return plain, np.where(inside, np.nan_to_num(row) * camera.width + np.nan_to_num(col), -1).astype(np.int64)


def make_matcher(surface: Surface, view: View, config: CorrectConfig) -> Matcher:
    """Points of the view on a raster, edges left out; and a coarser raster of all of them for the search."""
    c = config.register
    sigma = view_sigma(view, config.weights, np.ix_(*map(np.arange, view.depth.shape)))
    now = surface_of(view.camera, view.depth, sigma, c)
    points = view.camera.points(view.depth)
    step = raster_step(view.camera, c.pixels)
    taken = np.zeros(view.depth.shape, bool)
    taken[step // 2 :: step, step // 2 :: step] = True
    fine = taken & now.usable
    wide = raster_step(view.camera, 4 * c.coarse_pixels)
    coarse = np.zeros_like(taken)
    coarse[wide // 2 :: wide, wide // 2 :: wide] = True
    if not fine.any():
        raise RefusedError("empty view: no surface is seen", where="correction", todo="look at the part from 0.3 to 2 m")
    coarse &= view.valid & (sigma < 4e-3)
    return Matcher(
        surface, np.ascontiguousarray(points[fine]), sigma[fine], np.ascontiguousarray(points[coarse]), 3.0 * sigma[coarse], config
    )


def register_view(reference: Reference, surface: Surface, view: View, config: CorrectConfig, wide: Surface | None = None) -> Registration:
    """Pose of the view's camera in the reference's camera frame.

    The robot's own poses are the first guess. The arm's chain alone is another start, for the case that localisation jumped.
    If the reference does not determine the pose, the view is registered to `wide` (the CAD from the same pose, see
    `wide_surface`) and then again to the reference from there. If the two images overlap too little, the result by the CAD stands.
    """
    if view.robot is None:
        raise RefusedError("the view has no robot pose", where="correction", todo="record TF with the images")
    guess = se3.inverse(reference.T_cell_body @ reference.T_body_camera) @ view.robot.T_cell_camera
    by_arm = se3.inverse(reference.T_body_camera) @ view.robot.T_body_camera
    matcher = make_matcher(surface, view, config)
    found = register(matcher, guess, [by_arm])
    if wide is None or _whole(found):
        return found
    by_cad = register(matcher.against(wide), guess, [by_arm, found.T_reference_now])
    if not _whole(by_cad):
        return max((found, replace(by_cad, by="cad")), key=lambda r: r.accepted * (1 + r.unknown.rank))
    again = settle(matcher, by_cad.T_reference_now)
    return again if _whole(again) else replace(by_cad, by="cad")


def _whole(found: Registration) -> bool:
    return found.accepted and found.unknown.rank == 6
