# SPDX-License-Identifier: Apache-2.0
"""What the raster says about surfaces: how flat they are seen, and which pixels lie on none.

On a plane 1/z is linear in the ray's (x, y) at z = 1, so slopes and second differences are taken of w = 1/z: they are
exact for planes at any angle, and a second difference times z^2 is a deviation in metres.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numba import njit

from tof_core.reasons import Reason

if TYPE_CHECKING:
    from tof_core.arrays import Image
    from tof_preproc.config import PreprocConfig
    from tof_preproc.frame import Frame

FAN = np.sqrt(6.0)
"""Standard deviation of a second difference, or of the step to a line through two neighbours, in one pixel's."""
AXES = np.array([[0, 1], [1, 0], [1, 1], [1, -1]])


def remove_grazing(frame: Frame, config: PreprocConfig) -> int:
    """Remove surfaces whose normal is further than `max_deg` from the ray."""
    limit = np.float32(np.cos(np.deg2rad(config.grazing.max_deg)))
    return frame.remove(cos_incidence(frame.depth, frame.camera.rays()) < limit, Reason.GRAZING)


def remove_flying(frame: Frame, config: PreprocConfig) -> int:
    """Remove pixels at a depth edge that continue neither of its sides."""
    pitch = frame.camera.pixel_angle * np.tan(np.deg2rad(config.flying.slope_deg))
    mixed = _mixed(frame.depth, frame.sigma, AXES, np.float32(config.flying.ratio * FAN), np.float32(pitch))
    return frame.remove(mixed, Reason.FLYING)


@njit(cache=True, error_model="numpy")
def cos_incidence(depth, rays):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN201
    """Cosine (H, W) of the angle between ray and surface normal; NaN where there is no depth.

    Of the slopes to both sides the gentler one counts, and none where they disagree in sign: a depth edge is not a
    grazing surface. `rays` (H, W, 3) have z = 1.
    """
    height, width = depth.shape
    out = np.full((height, width), np.float32(np.nan))
    for v in range(height):
        for u in range(width):
            if np.isnan(depth[v, u]):
                continue
            w, x, y = 1 / depth[v, u], rays[v, u, 0], rays[v, u, 1]
            gx = _gentler(_slope(depth, rays, v, u, 0, -1), _slope(depth, rays, v, u, 0, 1))
            gy = _gentler(_slope(depth, rays, v, u, -1, 0), _slope(depth, rays, v, u, 1, 0))
            gz = w - gx * x - gy * y
            out[v, u] = w / np.sqrt((gx * gx + gy * gy + gz * gz) * (x * x + y * y + 1))
    return out


@njit(cache=True, error_model="numpy")
def _slope(depth, rays, v, u, dv, du):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Slope of 1/z over the ray's x (du) or y (dv) to a neighbour; NaN where there is none."""
    row, column = v + dv, u + du
    if row < 0 or column < 0 or row >= depth.shape[0] or column >= depth.shape[1]:
        return np.nan
    axis = 0 if du else 1
    return (1 / depth[row, column] - 1 / depth[v, u]) / (rays[row, column, axis] - rays[v, u, axis])


@njit(cache=True)
def _gentler(a, b):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """The slope nearer to zero; zero where the two disagree in sign; the other where one is unknown."""
    if np.isnan(a):
        return 0.0 if np.isnan(b) else b
    if np.isnan(b):
        return a
    if a * b <= 0:
        return 0.0
    return a if abs(a) < abs(b) else b


@njit(cache=True, error_model="numpy")
def _mixed(depth, sigma, axes, ratio, pitch):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Pixels (H, W) that on some axis cross a step and lie on no line through neighbours before, around or behind."""
    height, width = depth.shape
    out = np.zeros((height, width), np.bool_)
    for v in range(height):
        for u in range(width):
            z = depth[v, u]
            if np.isnan(z):
                continue
            tolerance = ratio * sigma[v, u]
            for a in range(axes.shape[0]):
                dv, du = axes[a]
                before, behind = _at(depth, v - dv, u - du), _at(depth, v + dv, u + du)
                step = max(abs(before - z) if before == before else 0.0, abs(behind - z) if behind == behind else 0.0)  # noqa: PLR0124
                if step < max(tolerance, z * pitch):
                    continue
                second = (1 / before + 1 / behind - 2 / z) * z * z
                first = (2 / before - 1 / _at(depth, v - 2 * dv, u - 2 * du) - 1 / z) * z * z
                third = (2 / behind - 1 / _at(depth, v + 2 * dv, u + 2 * du) - 1 / z) * z * z
                if not (abs(second) < tolerance or abs(first) < tolerance or abs(third) < tolerance):
                    out[v, u] = True
                    break
    return out


@njit(cache=True)
def _at(depth, v, u):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Depth at a pixel, NaN outside the raster."""
    inside = 0 <= v < depth.shape[0] and 0 <= u < depth.shape[1]
    return depth[v, u] if inside else np.float32(np.nan)
