# SPDX-License-Identifier: Apache-2.0
"""Pixels near depth edges, which mix two surfaces, and near structures that motion blurs."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numba import njit
from scipy.ndimage import binary_dilation, distance_transform_edt

from tof_sensor.frame import lambert_amplitude
from tof_sensor.geometry import image_flow

if TYPE_CHECKING:
    from tof_core.arrays import Float, Mask
    from tof_gap.limits.evidence import BlurLimits, EvidenceLimits
    from tof_sensor.frame import Frame

STEEPEST = 1.4
"""Radians: largest incidence whose slope is used, since the tangent grows without bound."""


def smear(frame: Frame, limits: BlurLimits) -> int:
    """Motion blur of a view in pixels: image flow during the longest exposure; 0 for a still view."""
    if not frame.context.twist.any() or not frame.valid.any():
        return 0
    blur = limits.exposure_s * np.quantile(np.hypot(*image_flow(frame))[frame.valid], limits.flow_quantile)
    return 0 if blur < limits.still_px else min(int(np.ceil(blur)), round(limits.most_share * frame.camera.width))


def excluded(frame: Frame, limits: EvidenceLimits, wider_px: int, blur_px: int) -> Mask:
    """(H, W) pixels that mixing or motion blur may reach.

    In a still view, pixels within `edge_px + wider_px` of a depth edge. In a moving view, pixels within `edge_px + blur_px` of a depth
    edge or, with `blur.creases`, of a brightness edge; `wider_px` is not added there, since blur already costs many pixels.
    """
    if blur_px:
        return edge_band(frame, limits.edge_px + blur_px, limits, creases=limits.blur.creases)
    return edge_band(frame, limits.edge_px + wider_px, limits)


def edge_band(frame: Frame, width: int, limits: EvidenceLimits, *, creases: bool = False) -> Mask:
    """(H, W) pixels within `width` of a depth edge or of the end of the CAD; with `creases`, of a brightness edge too."""
    z = frame.depth
    seam = frame.rendering.mixed > 0
    light = np.log(np.maximum(lambert_amplitude(frame.rendering), 1e-12)) if creases else None
    tilt = np.tan(np.minimum(np.nan_to_num(frame.rendering.incidence, nan=STEEPEST), STEEPEST)) * frame.camera.pixel_angle
    expected = z * (limits.edge_slope * tilt + limits.edge_slope * frame.camera.pixel_angle)
    for axis in (0, 1):
        step = np.abs(np.diff(z, axis=axis))
        jump = ~(step < np.minimum(np.delete(expected, -1, axis), np.delete(expected, 0, axis)))
        if light is not None:
            jump |= np.abs(np.diff(light, axis=axis)) > limits.crease
        pad = [(0, 0), (0, 0)]
        pad[axis] = (0, 1)
        seam = seam | np.pad(jump, pad)
        pad[axis] = (1, 0)
        seam = seam | np.pad(jump, pad)
    seam = seam | ~frame.valid
    return binary_dilation(seam, iterations=width) if width else seam


def streaks(residual: Float, sigma: Float, keep: Mask, limits: BlurLimits) -> Mask:
    """(H, W) thin streaks in the residual of a moving view: rims and low steps blur as edges do, and `edge_band` finds only some.

    A pixel is marked if it, or a neighbour, differs from the median around it by `streak_sigma` standard deviations.
    """
    keep = keep & np.isfinite(residual)
    if not keep.any():
        return np.zeros(keep.shape, bool)
    nearest = distance_transform_edt(~keep, return_distances=False, return_indices=True)
    around = np.pad(residual[tuple(nearest)], _reach(limits.streak_px), mode="edge")
    return np.asarray(binary_dilation(_off_median(around, limits.streak_sigma * sigma, keep, limits.streak_px)))


def _reach(size: int) -> tuple[int, int]:
    """Pixels of a window of `size` before and after its pixel."""
    return size // 2, size - 1 - size // 2


@njit(cache=True, nogil=True)
def _off_median(padded: Float, far: Float, asked: Mask, size: int) -> Any:
    """(H, W) asked pixels that differ by more than `far` (H, W) from the median of the `size` x `size` pixels around.

    The median is beyond a bound where half of the pixels are: counting them takes a tenth of the time of sorting.
    """
    out = np.zeros(asked.shape, np.bool_)
    before, half = size // 2, size * size // 2
    for v in range(asked.shape[0]):
        for u in range(asked.shape[1]):
            if asked[v, u]:
                middle = padded[v + before, u + before]
                low, high = middle - far[v, u], middle + far[v, u]
                lower, higher = 0, 0
                for y in range(v, v + size):
                    for x in range(u, u + size):
                        lower += padded[y, x] < low
                        higher += padded[y, x] > high
                out[v, u] = lower > half or higher >= size * size - half
    return out
