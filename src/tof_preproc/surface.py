# SPDX-License-Identifier: Apache-2.0
"""Surfaces in the raster: their incidence, and pixels that lie on none.

On a plane 1/z is linear in the ray's (x, y) at z = 1. Slopes and second differences are therefore taken of w = 1/z: they
are exact for planes at any angle, and a second difference times z^2 is a deviation in metres.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numba import njit

from tof_core.reasons import Reason
from tof_core.stats import SECOND_DIFFERENCE_STD

if TYPE_CHECKING:
    from tof_core.arrays import Float, Image, Ints, Mask
    from tof_core.camera import Camera
    from tof_preproc.config import PreprocConfig
    from tof_preproc.frame import Frame

PAIR, FAN = float(np.sqrt(2.0)), SECOND_DIFFERENCE_STD
"""Standard deviation of a difference, and of a second difference (or the step to a line through two), in units of one pixel's."""
ROUNDED = np.float32(1 - 1e-5)
"""Factor that takes a float32 limit below the same limit in float64."""
LOST = np.float32(1e-6)
"""Relative error of a depth by a second difference of 1/z in float32: eight roundings of half an ulp."""
AXES = np.array([[0, 1], [1, 0]])
"""Rows and columns: every edge crosses one of them. Along a diagonal, a clean corner would look like a mixed pixel."""


def remove_grazing(frame: Frame, config: PreprocConfig) -> int:
    """Remove surfaces whose normal is further than `max_deg` from the ray."""
    limit = np.float32(np.cos(np.deg2rad(config.grazing.max_deg)))
    return frame.remove(cos_incidence(frame.depth, frame.camera) < limit, Reason.GRAZING)


def remove_flying(frame: Frame, config: PreprocConfig) -> int:
    """Remove pixels at a depth edge that continue neither of its sides."""
    pitch = frame.camera.pixel_angle * np.tan(np.deg2rad(config.flying.slope_deg))
    mixed = _mixed(frame.depth, frame.sigma, AXES, config.flying.ratio, pitch)
    return frame.remove(mixed, Reason.FLYING)


def cos_incidence(depth: Image, camera: Camera) -> Image:
    """Cosine (H, W) of the angle between ray and surface normal; NaN where there is no depth.

    The smaller of the slopes to both sides counts, and zero where they differ in sign: a depth edge is not a grazing
    surface.
    """
    inverse = np.full((depth.shape[0] + 2, depth.shape[1] + 2), np.float32(np.nan))
    with np.errstate(divide="ignore"):
        np.divide(np.float32(1), depth, out=inverse[1:-1, 1:-1])
    return np.asarray(_cosine(inverse, *_raster(camera)))


@lru_cache(maxsize=16)
def _raster(camera: Camera) -> tuple[Image, ...]:
    """The rays' x and y at z = 1 (H, W), the inverse steps from pixel to pixel, (H, W + 1) and (H + 1, W), and the skew.

    Lens distortion makes y change along a row. The skew is the ratio of that change to x's, and the same along a column (H, W).
    """
    x, y = camera.rays()[..., 0], camera.rays()[..., 1]
    across, down = np.pad(1 / np.diff(x, axis=1), ((0, 0), (1, 1))), np.pad(1 / np.diff(y, axis=0), ((1, 1), (0, 0)))
    skew_x, skew_y = _gradient(y, 1) / _gradient(x, 1), _gradient(x, 0) / _gradient(y, 0)
    return tuple(np.ascontiguousarray(a, np.float32) for a in (x, y, across, down, skew_x, skew_y))


def _gradient(values: Float, axis: int) -> Float:
    """Central differences; ones for a raster of one line, which has no step to share."""
    return np.asarray(np.gradient(values, axis=axis)) if values.shape[axis] > 1 else np.ones_like(values)


@njit(cache=True, error_model="numpy")
def _cosine(inverse: Image, x: Image, y: Image, across: Image, down: Image, skew_x: Image, skew_y: Image) -> Image:
    """Of 1/z (H + 2, W + 2) with a rim of NaN."""
    height, width = x.shape
    out = np.empty((height, width), np.float32)
    for v in range(height):
        for u in range(width):
            w = inverse[v + 1, u + 1]
            gx = _gentler((w - inverse[v + 1, u]) * across[v, u], (inverse[v + 1, u + 2] - w) * across[v, u + 1])
            gy = _gentler((w - inverse[v, u + 1]) * down[v, u], (inverse[v + 2, u + 1] - w) * down[v + 1, u])
            gx, gy = (gx - skew_x[v, u] * gy), (gy - skew_y[v, u] * gx)
            gz = w - gx * x[v, u] - gy * y[v, u]
            ray2 = x[v, u] * x[v, u] + y[v, u] * y[v, u] + np.float32(1)
            out[v, u] = w / np.sqrt((gx * gx + gy * gy + gz * gz) * ray2)
    return out


@njit(cache=True)
def _gentler(a: np.float32, b: np.float32) -> np.float32:
    """The slope nearer to zero; zero where the two disagree in sign; the other where one is unknown (NaN)."""
    a_known, b_known = a == a, b == b  # noqa: PLR0124
    a0, b0 = a if a_known else (b if b_known else np.float32(0)), b if b_known else (a if a_known else np.float32(0))
    least = a0 if abs(a0) < abs(b0) else b0
    return least if a0 * b0 > 0 else np.float32(0)


@njit(cache=True, error_model="numpy")
def _mixed(depth: Image, sigma: Image, axes: Ints, ratio: float, pitch: float) -> Mask:
    """Pixels (H, W) that, along a row or a column, lie at a step or a hole and continue neither side of it.

    Nearly all pixels are as deep as their neighbours or in line with two of them. Branch-free passes over rows, eight pixels per
    instruction, find these in float32; the others are tested one by one.
    """
    height, width = depth.shape
    out = np.zeros((height, width), np.bool_)
    if height < 5 or width < 5:
        _mixed_among(depth, sigma, axes, ratio, pitch, np.zeros(1, np.bool_), 0, height, out)
        return out
    inverse = np.float32(1.0) / depth
    along, down, inner = np.zeros(width, np.bool_), np.zeros(width, np.bool_), slice(2, width - 2)
    for v in range(height):
        along[:], down[:] = False, False
        if 2 <= v < height - 2:
            z, w, noise = depth[v], inverse[v], sigma[v]
            _level(z[inner], z[1:-3], z[3:-1], noise[inner], np.float32(FAN * ratio), np.float32(pitch), along[inner])
            _level(z, depth[v - 1], depth[v + 1], noise, np.float32(FAN * ratio), np.float32(pitch), down)
            for side in (-1, 1):
                next_one, after = w[2 + side : width - 2 + side], w[2 + 2 * side : width - 2 + 2 * side]
                _in_line(z[inner], w[inner], next_one, after, noise[inner], np.float32(FAN * ratio), along[inner])
                _in_line(z, w, inverse[v + side], inverse[v + 2 * side], noise, np.float32(FAN * ratio), down)
        _mixed_among(depth, sigma, axes, ratio, pitch, along & down, v, v + 1, out)
    return out


@njit(cache=True)
def _level(z: Image, before: Image, behind: Image, sigma: Image, ratio: np.float32, pitch: np.float32, out: Mask) -> None:
    """Pixels (n,) that differ from the neighbours on both sides by less than noise and slope, rounding excluded."""
    for u in range(z.size):
        noise, slope = ratio * sigma[u], z[u] * pitch
        least = max(noise, slope) * ROUNDED
        out[u] = (abs(before[u] - z[u]) < least) & (abs(behind[u] - z[u]) < least)


@njit(cache=True)
def _in_line(z: Image, w: Image, next_one: Image, after: Image, sigma: Image, ratio: np.float32, out: Mask) -> None:
    """Add the pixels (n,) that are in line with the next two, of which w = 1/z is given; rounding of w excluded."""
    for u in range(z.size):
        off, at = abs(next_one[u] + next_one[u] - after[u] - w[u]), z[u]
        out[u] |= off * at * at + LOST * at < ratio * sigma[u]


@njit(cache=True, error_model="numpy")
def _mixed_among(depth: Image, sigma: Image, axes: Ints, ratio: float, pitch: float, sure: Mask, first: int, last: int, out: Mask) -> None:
    """Look at the pixels of some rows one by one, but those that are `sure` (W,) to continue a side; all of them where none is given."""
    for v in range(first, last):
        for u in range(depth.shape[1]):
            if sure.size == 1 or not sure[u]:
                out[v, u] = _continues_neither(depth, v, u, axes, ratio * sigma[v, u], depth[v, u] * pitch)


@njit(cache=True, error_model="numpy")
def _continues_neither(depth: Image, v: int, u: int, axes: Ints, noise: float, slope: float) -> bool:
    """Whether a pixel, along a row or a column, lies at a step or a hole and continues neither side of it."""
    z = depth[v, u]
    if np.isnan(z):
        return False
    least = max(FAN * noise, slope)
    for a in range(axes.shape[0]):
        dv, du = axes[a]
        before, behind = _at(depth, v - dv, u - du), _at(depth, v + dv, u + du)
        if (abs(before - z) < least and abs(behind - z) < least) or (np.isnan(before) and np.isnan(behind)):
            continue
        if _goes_with(z, before, _at(depth, v - 2 * dv, u - 2 * du), noise, slope):
            continue
        if not _goes_with(z, behind, _at(depth, v + 2 * dv, u + 2 * du), noise, slope):
            return True
    return False


@njit(cache=True, error_model="numpy")
def _goes_with(z: float, next_one: float, one_after: float, noise: float, slope: float) -> bool:
    """Whether a depth equals the next pixel's or is in line with the next two; with one neighbour any slope fits.

    (Being in line with one pixel of each side proves nothing: a half-mixed pixel is.)
    """
    off = abs(next_one - z)
    if off < PAIR * noise:
        return True
    if np.isnan(one_after):
        return off < slope
    return abs(2 / next_one - 1 / one_after - 1 / z) * z * z < FAN * noise


@njit(cache=True)
def _at(depth: Image, v: int, u: int) -> np.float32:
    """Depth at a pixel, NaN outside the raster."""
    inside = 0 <= v < depth.shape[0] and 0 <= u < depth.shape[1]
    return depth[v, u] if inside else np.float32(np.nan)
