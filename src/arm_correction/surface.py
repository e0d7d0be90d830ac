# SPDX-License-Identifier: Apache-2.0
"""A depth image as a surface: points, normals, their uncertainties, and pixels away from edges."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy import ndimage

if TYPE_CHECKING:
    from arm_correction.config import RegisterConfig
    from tof_core.arrays import Float, Image, Mask
    from tof_core.camera import Camera


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """The surface in a depth image, camera frame, all (H, W).

    depth metres, NaN invalid; normal (H, W, 3) unit, toward the camera; sigma metres along z;
    tilt: standard deviation of the normal, radians; usable: has a normal, on no edge, not grazing.
    """

    camera: Camera
    depth: Float
    normal: Float
    sigma: Float
    tilt: Float
    usable: Mask


def surface_of(camera: Camera, depth: Image, sigma: Float, config: RegisterConfig, where: Mask | None = None) -> Surface:
    """Fit planes over windows: on a plane 1 / z is linear in the pixel's coordinates.

    Args:
        camera: the raster.
        depth: (H, W) z metres.
        sigma: (H, W) its standard error, metres.
        config: window and grazing limit.
        where: (H, W) pixels that may be used (default: all).
    """
    r = config.window
    z = np.asarray(depth, float)
    valid = np.isfinite(z)
    inverse = np.where(valid, 1.0 / np.where(valid, z, 1.0), 0.0)
    whole = ndimage.minimum_filter(valid.astype(np.uint8), 2 * r + 1, mode="constant").astype(bool)
    offset = np.arange(-r, r + 1, dtype=float)
    ones, moment = np.full(2 * r + 1, 1.0 / (2 * r + 1)), (offset * offset).sum()
    rows, cols = _along(inverse, ones, 0), _along(inverse, ones, 1)
    du, dv = _along(rows, offset / moment, 1), _along(cols, offset / moment, 0)
    mean, square = _along(rows, ones, 1), _along(_along(inverse**2, ones, 0), ones, 1)
    spread = square - mean**2 - (du**2 + dv**2) * moment / (2 * r + 1)
    misfit = np.sqrt(np.maximum(spread, 0.0)) * np.where(valid, z, 0.0) ** 2
    rays = camera.rays()
    gx, gy = camera.fx * du, camera.fy * dv
    normal = -np.stack([gx, gy, mean - rays[..., 0] * gx - rays[..., 1] * gy], axis=-1)
    size = np.linalg.norm(normal, axis=-1, keepdims=True)
    normal /= np.where(size > 0, size, 1.0)
    facing = -np.einsum("ijk,ijk->ij", normal, rays) / camera.ray_length()
    usable = whole & (facing > np.cos(np.radians(config.grazing_deg))) & (misfit < 3.0 * sigma + 1.5e-3)
    if where is not None:
        usable &= where
    pitch = np.where(valid, z, 1.0) / (0.5 * (camera.fx + camera.fy))
    tilt = sigma / (pitch * np.sqrt((2 * r + 1) * moment))
    return Surface(camera, z, normal, np.asarray(sigma, float), tilt, usable)


def _along(values: Float, kernel: Float, axis: int) -> Float:
    return np.asarray(ndimage.correlate1d(values, kernel, axis=axis, mode="nearest"))
