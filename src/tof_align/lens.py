# SPDX-License-Identifier: Apache-2.0
"""A lens that differs from CameraInfo: changes of depth by its parameters, as columns with a size to be estimated.

A calibration is good to some tenths of a pixel; a wrong one is off by several. Its error turns the pixels' rays. Besides, the camera
converts the distance along a ray to z by the stated lens or by the true one (`intrinsics` in docs/effects.md). A pose imitates both, so
that poses solved with the stated lens alone are off by millimetres or centimetres. Turned rays and conversion have separate
coefficients, so either conversion is covered.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from tof_core.lens import LENS, ray_shift, with_lens

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_align.linearise import Linearised
    from tof_core.arrays import Float
    from tof_core.camera import Camera
    from tof_core.capture import View

FOCAL, CENTRE, RADIAL, TANGENTIAL = 0.002, 0.005, 0.01, 1e-4
"""Proportions of a lens's errors: relative focal length, principal point in tangents (one pixel of 200 per radian), k1 and k2, p1 and p2.
They follow the differences of calibrations of one lens; the common size is estimated."""


def lens_columns(view: Linearised, camera: Camera) -> Float:
    """(n, 16) metres of z by turned rays (8) and by the conversion from distance (8), for one deviation of each parameter of `LENS`."""
    shift = ray_shift(view.ray, camera) * deviations(camera)
    turned = np.einsum("ni,nik->nk", view.jacobian[:, :2], shift)
    longer = np.einsum("ni,nik->nk", view.ray[:, :2], shift) / (view.ray_length**2)[:, None]
    return np.asarray(view.depth[:, None] * np.concatenate([turned, longer], axis=1))


def deviations(camera: Camera) -> Float:
    """(8,) the deviations above, in the units of `LENS`."""
    return np.array([FOCAL, FOCAL, CENTRE * camera.fx, CENTRE * camera.fy, RADIAL, RADIAL, TANGENTIAL, TANGENTIAL])


def lens_scale(views: Sequence[Linearised]) -> float:
    """RMS in metres of the depth change by a lens with these deviations; 0 where it was not computed."""
    known = [v.lens for v in views if v.lens is not None and len(v.lens)]
    if len(known) < sum(len(v.residual) > 0 for v in views):
        return 0.0
    return float(np.sqrt(np.mean([(block**2).sum(axis=1).mean() for block in known]))) if known else 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Lens:
    """The lens that a session shows.

    camera: with that lens; conversion (8,): parameters `LENS` by which distance was converted to z, less those of `camera`; 0 if equal.
    """

    camera: Camera
    conversion: Float

    def over(self, view: View) -> View:
        """The view with the rays of that camera, and z along them."""
        rays = view.camera.rays()
        longer = np.einsum("hwi,hwik,k->hw", rays[..., :2], ray_shift(rays, view.camera), self.conversion) / view.camera.ray_length() ** 2
        return replace(view, camera=self.camera, depth=(view.depth / (1.0 + longer)).astype(view.depth.dtype))


def estimated_lens(stated: Camera, coefficients: Float, scale: float) -> Lens:
    """The lens that the coefficients (16,) of unit-size columns mean.

    However near the stated lens, it is the one beside which the poses were solved: through the stated one they would render other labels.
    """
    turned, conversion = coefficients.reshape(2, len(LENS)) / scale * deviations(stated)
    return Lens(with_lens(stated, turned), conversion)
