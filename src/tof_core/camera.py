# SPDX-License-Identifier: Apache-2.0
"""The camera model; every parameter comes from CameraInfo.

The centre of pixel (0, 0) has the coordinates (0, 0), as in OpenCV and ROS. Depth is z along the optical
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
"""Distortion models that are read, and their number of coefficients (thin prism and tilt are refused)."""


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
        """Refuse an uncalibrated camera, an empty raster and an unknown distortion."""
        if not (self.fx > 0 and self.fy > 0 and np.isfinite([self.fx, self.fy, self.cx, self.cy]).all()):
            msg = f"is uncalibrated (K[0] = {self.fx:g}, K[4] = {self.fy:g})"
            raise CameraError(msg, where="camera_info", todo="calibrate the camera or publish its K")
        if self.width < 1 or self.height < 1:
            msg = f"has size {self.width}x{self.height}"
            raise CameraError(msg, where="camera_info")
        if self.distortion_model not in MODELS and any(self.distortion):
            msg = f"distortion model '{self.distortion_model}' is not known"
            raise CameraError(msg, where="camera_info", todo=f"use one of {', '.join(filter(None, MODELS))}")
        if any(self.distortion[MODELS.get(self.distortion_model, 0) :]) or not np.isfinite(self.distortion).all():
            msg = f"distortion {self.distortion} is more than '{self.distortion_model}' has, or not finite"
            raise CameraError(msg, where="camera_info", todo="calibrate with plumb_bob (5) or rational_polynomial (8)")

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
        """Pixel coordinates (..., 2) of points (..., 3) in the camera frame; NaN behind the camera and outside the lens's field."""
        p = np.asarray(points, float)
        z = np.where(p[..., 2] > 0, p[..., 2], np.nan)
        xy = p[..., :2] / z[..., None]
        if self.distorted:
            # Beyond the fold radius the polynomial maps points back into the image, which a real lens does not.
            seen = (xy * xy).sum(axis=-1) < _fold_radius(self.distortion) ** 2
            xy = np.where(seen[..., None], distort(xy, self.distortion), np.nan)
        return np.asarray(xy * [self.fx, self.fy] + [self.cx, self.cy])

    def points(self, depth: Image) -> Float:
        """(H, W, 3) points in the camera frame of a z-depth image (H, W)."""
        return np.asarray(self.rays() * np.asarray(depth, float)[..., None])

    def ray_length(self) -> Float:
        """(H, W) radial distance per metre of z."""
        return _ray_length(self)

    def scaled(self, factor: int) -> Camera:
        """The same view on a raster `factor` times finer."""
        f = float(factor)
        return replace(
            self,
            width=self.width * factor,
            height=self.height * factor,
            fx=self.fx * f,
            fy=self.fy * f,
            cx=(self.cx + 0.5) * f - 0.5,
            cy=(self.cy + 0.5) * f - 0.5,
        )


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


def distort(xy: Float, distortion: tuple[float, ...]) -> Float:
    """Normalised coordinates (..., 2) after distortion by up to eight coefficients (OpenCV's rational model)."""
    k1, k2, p1, p2, k3, k4, k5, k6 = _coefficients(distortion)
    x, y = xy[..., 0], xy[..., 1]
    r2 = x * x + y * y
    radial = (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1 + r2 * (k4 + r2 * (k5 + r2 * k6)))
    return np.stack(
        [
            x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
            y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
        ],
        axis=-1,
    )


def distortion_jacobian(x: Float, distortion: tuple[float, ...]) -> tuple[Float, Float, Float, Float]:
    """Derivatives of `distort`: dx'/dx, dx'/dy, dy'/dx, dy'/dy at normalised coordinates (..., 2)."""
    k1, k2, p1, p2, k3, k4, k5, k6 = _coefficients(distortion)
    u, v = x[..., 0], x[..., 1]
    r2 = u * u + v * v
    top, bottom = 1 + r2 * (k1 + r2 * (k2 + r2 * k3)), 1 + r2 * (k4 + r2 * (k5 + r2 * k6))
    radial = top / bottom
    slope = 2 * ((k1 + r2 * (2 * k2 + 3 * r2 * k3)) - radial * (k4 + r2 * (2 * k5 + 3 * r2 * k6))) / bottom
    cross = slope * u * v + 2 * p1 * u + 2 * p2 * v
    return radial + slope * u * u + 2 * p1 * v + 6 * p2 * u, cross, cross, radial + slope * v * v + 6 * p1 * v + 2 * p2 * u


@lru_cache(maxsize=16)
def _fold_radius(distortion: tuple[float, ...]) -> float:
    """Undistorted radius (z = 1) at which the radial polynomial turns back; infinite where it never does."""
    k1, k2, _, _, k3, k4, k5, k6 = _coefficients(distortion)
    r = np.linspace(0.0, 10.0, 20001)
    r2 = r * r
    bent = r * (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1 + r2 * (k4 + r2 * (k5 + r2 * k6)))
    turned = np.nonzero(np.diff(bent) <= 0)[0]
    return float(r[turned[0]]) if len(turned) else float("inf")


def _undistort(xy: Float, distortion: tuple[float, ...], rounds: int = 60) -> Float:
    """Solve `distort(x) == xy` by Newton's method.

    Where the model folds over (outside the lens's field) the answer is NaN, never a guess.
    """
    x = xy.copy()
    for _ in range(rounds):
        error = distort(x, distortion) - xy
        if not np.nanmax(np.abs(error), initial=0.0) > 1e-12:
            break
        a, b, c, d = distortion_jacobian(x, distortion)
        det = a * d - b * c
        det = np.where(np.abs(det) < 1e-3, np.nan, det)
        step = np.stack([(d * error[..., 0] - b * error[..., 1]) / det, (a * error[..., 1] - c * error[..., 0]) / det], axis=-1)
        x = x - np.clip(step, -0.2, 0.2)
    solved = np.abs(distort(x, distortion) - xy).max(axis=-1) < 1e-9
    x[~(solved & ((x * x).sum(axis=-1) < _fold_radius(distortion) ** 2))] = np.nan
    return x


def radial_to_z(camera: Camera, radial: Image) -> Image:
    """z-depth (H, W) of distances along the rays (H, W), metres."""
    return (radial / camera.ray_length()).astype(np.float32)
