# SPDX-License-Identifier: Apache-2.0
"""A lens that differs from CameraInfo's: eight parameters, their effect on the rays, and the resulting camera."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from tof_core.camera import MODELS

if TYPE_CHECKING:
    from tof_core.arrays import Float
    from tof_core.camera import Camera

LENS = ("fx_rel", "fy_rel", "cx_px", "cy_px", "k1", "k2", "p1", "p2")
"""Differences of a lens from the stated one: relative focal lengths, principal point in pixels, distortion (plumb_bob)."""


def with_lens(stated: Camera, difference: Float) -> Camera:
    """The camera whose lens differs by (8,) `LENS` from the stated one."""
    fx, fy, cx, cy, *distortion = np.asarray(difference, float).tolist()
    d = np.zeros(max(len(stated.distortion), 5))
    d[: len(stated.distortion)] = stated.distortion
    d[:4] += distortion
    return replace(
        stated,
        fx=stated.fx * (1 + fx),
        fy=stated.fy * (1 + fy),
        cx=stated.cx + cx,
        cy=stated.cy + cy,
        distortion_model=stated.distortion_model if MODELS.get(stated.distortion_model) else "plumb_bob",
        distortion=tuple(d.tolist()),
    )


def ray_shift(rays: Float, camera: Camera) -> Float:
    """(..., 2, 8) true minus stated ray, normalised x and y, by each parameter of `LENS`, for rays (..., 3) with z = 1; zero where NaN."""
    x, y = np.moveaxis(rays[..., :2], -1, 0)
    r2, zero = x * x + y * y, np.zeros_like(x)
    shift_x = [-x, zero, zero - 1 / camera.fx, zero, -x * r2, -x * r2 * r2, -2 * x * y, -(r2 + 2 * x * x)]
    shift_y = [zero, -y, zero, zero - 1 / camera.fy, -y * r2, -y * r2 * r2, -(r2 + 2 * y * y), -2 * x * y]
    return np.asarray(np.nan_to_num(np.stack([np.stack(shift_x, -1), np.stack(shift_y, -1)], axis=-2)))


def apart_px(one: Camera, other: Camera) -> float:
    """Largest angle between the rays of one pixel through two lenses, in pixels of the first."""
    return float(np.nanmax(np.abs(one.rays() - other.rays())) / one.pixel_angle)


def apart_rms_px(one: Camera, other: Camera) -> float:
    """RMS over the image of the angle between the rays of one pixel through two lenses, in pixels of the first."""
    off = (one.rays() - other.rays())[..., :2]
    return float(np.sqrt(np.nanmean(np.sum(off**2, axis=-1))) / one.pixel_angle)
