# SPDX-License-Identifier: Apache-2.0
"""One measured view, and the CAD rendered at its pose."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tof_core import se3
from tof_core.reasons import Reason
from tof_core.stats import second_differences, trimmed_std

if TYPE_CHECKING:
    from tof_core.arrays import Bytes, Float, Image, Ints, Mask
    from tof_core.camera import Camera
    from tof_scene.world.limits import WorldLimits


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """Arrays (H, W), depths along z in metres.

    depth: measured, NaN without a return; noise: standard deviation of a pixel of it, NaN where unknown; cad: rendered depth, NaN where
    the ray misses; cad_sigma: its standard deviation by pose and CAD; part: index of the part, -1 none; reason: why a pixel has no depth
    (`tof_core.reasons`); amplitude: or None; apart: distance of the pixel's part from its CAD by the session's solution, or None.
    """

    camera: Camera
    T_cell_camera: Float
    depth: Image
    noise: Image
    cad: Image
    cad_sigma: Image
    part: Ints
    reason: Bytes
    amplitude: Image | None = None
    apart: Image | None = None

    @property
    def saturated(self) -> Mask:
        """(H, W) saturated pixels."""
        return np.asarray(self.reason == Reason.SATURATED)

    def in_place(self, limits: WorldLimits) -> Mask:
        """(H, W) pixels of parts that are at their place by the session's solution; all without a solution."""
        return np.ones(self.depth.shape, bool) if self.apart is None else np.asarray(self.apart < 1e-3 * limits.stray_mm)

    @property
    def residual(self) -> Float:
        """(H, W) measured minus rendered, NaN where either is missing."""
        return np.asarray(self.depth.astype(np.float64) - self.cad)

    @property
    def noise_or_own(self) -> Float:
        """(H, W) `noise`; where it is unknown, the standard deviation of second differences of all residuals. Undefined without a residual."""
        known, residual = np.isfinite(self.noise), self.residual
        lacking = bool((~known & np.isfinite(residual)).any())
        return np.where(known, self.noise, _own_noise(residual) if lacking else 0.0).astype(float)

    def points(self, where: Mask, depth: Float) -> Float:
        """(n, 3) points in the cell of the pixels of a mask (H, W), at depths (H, W)."""
        rays = self.camera.rays()[where]
        return np.asarray(se3.apply(self.T_cell_camera, rays * depth[where][:, None]))

    def pixels_of(self, points: Float) -> tuple[Ints, Ints, Float, Mask]:
        """Row, column and depth (n,) of points (n, 3) of the cell in this view, and whether they are within the image."""
        p = se3.apply(se3.inverse(self.T_cell_camera), points)
        front = p[:, 2] > 0.05
        uv = self.camera.project(np.where(front[:, None], p, [0.0, 0.0, 1.0]))
        at = np.floor(np.nan_to_num(uv, nan=-9.0) + 0.5).astype(np.int64)
        inside = front & (at >= 0).all(axis=1) & (at[:, 0] < self.camera.width) & (at[:, 1] < self.camera.height)
        u, v = np.clip(at[:, 0], 0, self.camera.width - 1), np.clip(at[:, 1], 0, self.camera.height - 1)
        return v, u, np.asarray(p[:, 2]), np.asarray(inside)


def _own_noise(residual: Float) -> float:
    """Standard deviation of the white noise in a residual (H, W), metres; 0 where nothing is measured."""
    differences = np.concatenate([second_differences(residual, axis).ravel() for axis in (0, 1)])
    differences = differences[np.isfinite(differences)]
    return trimmed_std(differences) if len(differences) else 0.0
