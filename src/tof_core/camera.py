# SPDX-License-Identifier: Apache-2.0
"""The camera model: what CameraInfo says, and nothing from constants.

Pixel (0, 0)'s centre has the coordinates (0, 0) (OpenCV, ROS). Depth is z along the optical
axis (REP 118); *radial* is the distance along the pixel's ray.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from tof_core.errors import CameraError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from tof_core.arrays import Float, Image

MODELS = {"": 0, "plumb_bob": 5, "rational_polynomial": 8}
"""Known distortion models with the number of coefficients they use at most (rational: first 8)."""


@dataclass(frozen=True, slots=True)
class Camera:
    """Intrinsics of one raster: size in pixels, focal lengths and principal point in pixels.

    `distortion` holds k1 k2 p1 p2 k3 [k4 k5 k6] as in `sensor_msgs/CameraInfo`.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion_model: str = "plumb_bob"
    distortion: tuple[float, ...] = ()
    frame_id: str = ""

    def __post_init__(self) -> None:
        """Refuse what no calibration would give."""
        if not (self.fx > 0 and self.fy > 0 and np.isfinite([self.fx, self.fy, self.cx, self.cy]).all()):
            msg = f"is uncalibrated (K[0] = {self.fx:g}, K[4] = {self.fy:g})"
            raise CameraError(msg, where="camera_info", todo="calibrate the camera or publish its K")
        if self.width < 1 or self.height < 1:
            msg = f"has size {self.width}x{self.height}"
            raise CameraError(msg, where="camera_info")
        if self.distortion_model not in MODELS and any(self.distortion):
            msg = f"distortion model '{self.distortion_model}' is not known"
            raise CameraError(msg, where="camera_info", todo=f"use one of {', '.join(filter(None, MODELS))}")

    @property
    def shape(self) -> tuple[int, int]:
        """(H, W)."""
        return self.height, self.width

    @property
    def K(self) -> Float:
        """Camera matrix (3, 3)."""
        return np.array([[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1.0]])

    @property
    def distorted(self) -> bool:
        """Whether any distortion coefficient is not zero."""
        return any(self.distortion)

    @property
    def pixel_angle(self) -> float:
        """Angle of the central pixel in radians (mean of both axes)."""
        return 0.5 * (1 / self.fx + 1 / self.fy)

    def rays(self) -> Float:
        """(H, W, 3) directions with z = 1 through the pixel centres; cached, read-only."""
        return _rays(self)

    def rays_at(self, uv: ArrayLike) -> Float:
        """(..., 3) directions with z = 1 through pixel coordinates (..., 2)."""
        uv = np.asarray(uv, float)
        xy = (uv - [self.cx, self.cy]) / [self.fx, self.fy]
        if self.distorted:
            xy = _undistort(xy, self.distortion)
        return np.concatenate([xy, np.ones((*xy.shape[:-1], 1))], axis=-1)

    def project(self, points: ArrayLike) -> Float:
        """Pixel coordinates (..., 2) of points (..., 3) in the camera frame; NaN behind it."""
        p = np.asarray(points, float)
        z = np.where(p[..., 2] > 0, p[..., 2], np.nan)
        xy = p[..., :2] / z[..., None]
        if self.distorted:
            xy = _distort(xy, self.distortion)
        return np.asarray(xy * [self.fx, self.fy] + [self.cx, self.cy])

    def points(self, depth: Image) -> Float:
        """(H, W, 3) points in the camera frame of a z-depth image (H, W)."""
        return self.rays() * np.asarray(depth, float)[..., None]

    def ray_length(self) -> Float:
        """(H, W) radial distance per metre of z."""
        return _ray_length(self)

    def scaled(self, factor: int) -> Camera:
        """The same view on a raster `factor` times finer."""
        f = float(factor)
        return replace(self, width=self.width * factor, height=self.height * factor, fx=self.fx * f, fy=self.fy * f,
                       cx=(self.cx + 0.5) * f - 0.5, cy=(self.cy + 0.5) * f - 0.5)


@lru_cache(maxsize=16)
def _rays(camera: Camera) -> Float:
    v, u = np.mgrid[: camera.height, : camera.width]
    rays = camera.rays_at(np.stack([u, v], axis=-1))
    rays.setflags(write=False)
    return rays


@lru_cache(maxsize=16)
def _ray_length(camera: Camera) -> Float:
    length = np.asarray(np.linalg.norm(_rays(camera), axis=-1))
    length.setflags(write=False)
    return length


def _coefficients(distortion: tuple[float, ...]) -> tuple[float, ...]:
    return (*distortion, *(0.0,) * 8)[:8]


def _distort(xy: Float, distortion: tuple[float, ...]) -> Float:
    """Normalised coordinates as the lens bends them (OpenCV's rational model)."""
    k1, k2, p1, p2, k3, k4, k5, k6 = _coefficients(distortion)
    x, y = xy[..., 0], xy[..., 1]
    r2 = x * x + y * y
    radial = (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1 + r2 * (k4 + r2 * (k5 + r2 * k6)))
    return np.stack([
        x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
        y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
    ], axis=-1)


def _undistort(xy: Float, distortion: tuple[float, ...], rounds: int = 60) -> Float:
    """Solve `_distort(x) == xy` by Newton's method with a numerical Jacobian.

    Where the model folds over (outside the lens's field) the answer is NaN, never a guess.
    """
    x = xy.copy()
    h = 1e-6
    for _ in range(rounds):
        error = _distort(x, distortion) - xy
        if not np.nanmax(np.abs(error), initial=0.0) > 1e-12:
            break
        jx = (_distort(x + [h, 0], distortion) - _distort(x - [h, 0], distortion)) / (2 * h)
        jy = (_distort(x + [0, h], distortion) - _distort(x - [0, h], distortion)) / (2 * h)
        det = jx[..., 0] * jy[..., 1] - jx[..., 1] * jy[..., 0]
        det = np.where(np.abs(det) < 1e-3, np.nan, det)
        step = np.stack([
            (jy[..., 1] * error[..., 0] - jy[..., 0] * error[..., 1]) / det,
            (jx[..., 0] * error[..., 1] - jx[..., 1] * error[..., 0]) / det,
        ], axis=-1)
        x = x - np.clip(step, -0.2, 0.2)
    lost = ~(np.abs(_distort(x, distortion) - xy).max(axis=-1) < 1e-9)
    x[lost] = np.nan
    return np.asarray(x)


def radial_to_z(camera: Camera, radial: Image) -> Image:
    """z-depth (H, W) of distances along the rays (H, W), metres."""
    return (radial / camera.ray_length()).astype(np.float32)


def z_to_radial(camera: Camera, depth: Image) -> Image:
    """Distances along the rays (H, W) of z-depth (H, W), metres."""
    return (depth * camera.ray_length()).astype(np.float32)
