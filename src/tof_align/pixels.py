# SPDX-License-Identifier: Apache-2.0
"""The pixels of a view that a registration uses: a raster of rays with depth and noise."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from tof_align.config import WeightConfig
    from tof_core.arrays import Float, Image, Ints, Mask
    from tof_core.camera import Camera
    from tof_core.capture import RobotPose, View

ROUNDING = 1e-4
"""Share of a window below which it contains no pixel: rounding of single precision."""


@dataclass(frozen=True, slots=True, eq=False)
class Pixels:
    """A raster (h, w) of a view's pixels.

    index: flat indices into (H, W); rays: (h, w, 3) with z = 1; depth and sigma in metres
    (NaN depth is invalid); log_amplitude or None; `angle`: the pixel's angle in radians.
    """

    camera: Camera
    index: Ints
    rays: Float
    depth: Float
    sigma: Float
    log_amplitude: Float | None
    angle: float

    @property
    def shape(self) -> tuple[int, int]:
        """(h, w) of the raster."""
        return self.depth.shape[0], self.depth.shape[1]

    def through(self, camera: Camera) -> Pixels:
        """The same pixels seen through another lens."""
        return replace(self, camera=camera, rays=camera.rays().reshape(-1, 3)[self.index], angle=camera.pixel_angle)

    def thinned(self, pixels: int) -> Pixels:
        """Every k-th row and column, so that about `pixels` are left (all, where there are no more)."""
        k = max(1, round(float(np.sqrt(self.depth.size / pixels))))
        if k == 1:
            return self
        at = np.s_[k // 2 :: k, k // 2 :: k]
        amplitude = None if self.log_amplitude is None else self.log_amplitude[at]
        return Pixels(self.camera, self.index[at], self.rays[at], self.depth[at], self.sigma[at], amplitude, self.angle)


def take_pixels(view: View, config: WeightConfig, *, pixels: int = 0) -> Pixels:
    """A raster of about `pixels` (default: the configured number) of a view's pixels."""
    camera = view.camera
    at, index, rays = _raster(camera, raster_step(camera, pixels or config.pixels))
    return Pixels(
        camera=camera,
        index=index,
        rays=rays,
        depth=view.depth[at].astype(float),
        sigma=view_sigma(view, config, at),
        log_amplitude=_log_amplitude(view.amplitude, at),
        angle=camera.pixel_angle,
    )


@dataclass(frozen=True, slots=True, eq=False)
class Sample:
    """The part of a view that registration keeps: a raster of its pixels, and the robot's pose."""

    stamp_ns: int
    station: int
    robot: RobotPose | None
    full: Pixels
    config: WeightConfig

    @property
    def fine(self) -> Pixels:
        """The raster of most linearisations."""
        return self.full.thinned(self.config.pixels)

    @property
    def coarse(self) -> Pixels:
        """The raster while far from the answer."""
        return self.full.thinned(self.config.coarse_pixels)


def sample(view: View, config: WeightConfig) -> Sample:
    """The sample of a view."""
    return Sample(view.stamp_ns, view.station, view.robot, take_pixels(view, config, pixels=config.last_pixels), config)


@lru_cache(maxsize=16)
def _raster(camera: Camera, step: int) -> tuple[tuple[Ints, ...], Ints, Float]:
    """Rows and columns of a raster, its flat indices and its rays (shared by all views, read-only)."""
    rows = np.arange(step // 2, camera.height, step)
    cols = np.arange(step // 2, camera.width, step)
    at = np.ix_(rows, cols)
    rays = camera.rays()[at]
    rays.setflags(write=False)
    return at, np.asarray(rows[:, None] * camera.width + cols[None, :]), rays


def raster_step(camera: Camera, pixels: int) -> int:
    """The stride that leaves about `pixels` of the camera's pixels."""
    return max(1, round(float(np.sqrt(camera.width * camera.height / pixels))))


def _log_amplitude(amplitude: Image | None, at: tuple[Ints, ...]) -> Float | None:
    if amplitude is None:
        return None
    a = amplitude[at].astype(float)
    return np.where(a > 0, np.log(np.where(a > 0, a, 1.0)), np.nan)


def view_sigma(view: View, config: WeightConfig, at: tuple[Ints, ...]) -> Float:
    """Standard error of the pixels `at` in metres, with the noise of few captures pooled.

    The variance of n captures is itself uncertain (chi-square with n - 1 degrees of freedom). It is averaged with that of its
    neighbours, which counts as eight captures more.
    """
    assumed = config.noise_mm * 1e-3 / np.sqrt(np.maximum(view.count, 1))
    measured = np.isfinite(view.sigma) & (view.sigma > 0) & (view.count > 1)
    if measured.any():
        variance = np.where(measured, np.where(measured, view.sigma, 0.0).astype(float) ** 2, 0.0)
        near, share = _local_mean(variance, measured)
        dof = np.maximum(view.count.astype(float) - 1.0, 0.0) * measured
        pooled = np.where(share > 0, (dof * variance + 8.0 * near) / (dof + 8.0), assumed**2)
        sigma = np.sqrt(pooled[at])
    else:
        sigma = assumed[at]
    return np.asarray(np.hypot(sigma, config.floor_mm * 1e-3))


def _local_mean(values: Float, where: Mask, size: int = 7) -> tuple[Float, Float]:
    from scipy import ndimage

    share = ndimage.uniform_filter(where.astype(np.float32), size, mode="nearest").astype(float)
    total = ndimage.uniform_filter(values.astype(np.float64), size, mode="nearest")
    share = np.where(share > ROUNDING, share, 0.0)
    return total / np.where(share > 0, share, 1.0), share
