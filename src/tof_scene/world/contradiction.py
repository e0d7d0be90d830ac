# SPDX-License-Identifier: Apache-2.0
"""Pixels of one view where measurement and CAD contradict each other.

A patch begins where the median of 3 x 3 pixels lies outside of the depths that the CAD has within one pixel (a pose that is off
by a pixel, and mixed pixels, stay inside), and grows over neighbours that deviate by less. Its rim has no return: the camera
filters it. Noise is averaged by the median; smooth errors of the sensor are subtracted before (`bias`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numba
import numpy as np
from scipy import ndimage

from tof_core.stats import robust_std

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Float, Mask
    from tof_scene.world.limits import WorldLimits
    from tof_scene.world.seen import Seen

EIGHT = np.ones((3, 3), bool)
"""Neighbours of a pixel, diagonal ones too."""


def contradictions(seen: Seen, bias: Float, spread: float, limits: WorldLimits) -> tuple[Mask, Mask]:
    """(H, W) pixels measured before the CAD, and behind it; pixels without a return at a patch's rim are in the patch's.

    Args:
        seen: the view.
        bias: (H, W) metres of z that the sensor's own effects add.
        spread: standard deviation, metres, of what is smooth in the session's residuals beside (`smooth_spread`).
        limits: what is allowed.
    """
    measured = seen.depth.astype(np.float64) - bias
    noise = seen.noise_or_own
    allowed = allowance(seen, spread, limits)
    error = measured - seen.cad
    beyond, middle = _medians(measured, seen.cad.astype(float), error)
    strong = (np.abs(beyond) > allowed + limits.noise_sigma * noise) & (np.abs(error) > allowed)
    weak = (np.abs(middle) > limits.weak * (allowed + limits.noise_sigma * noise)) | (
        np.abs(error) > allowed + 2 * limits.noise_sigma * noise
    )
    sides = []
    for side in (-1.0, 1.0):
        mine = side * error > 0
        seed = _large(strong & mine, limits.patch_px)
        sides.append(ndimage.binary_propagation(seed, structure=EIGHT, mask=(weak & mine) | seed))
    lost = ~np.isfinite(error) & np.isfinite(seen.cad)
    return _with_rim(sides[0], lost, lost & seen.saturated, limits.rim_px), _with_rim(sides[1], lost, lost & seen.saturated, limits.rim_px)


def strays(seen: Seen, bias: Float, known: Mask, limits: WorldLimits) -> Mask:
    """(H, W) single pixels beside a contradiction `known` (H, W), or beside a part that stands off its CAD, that deviate by themselves.

    The outline of a part that stands elsewhere is a strip of a pixel or two, too narrow for a patch, and the depths that the CAD has
    beside it excuse it.
    """
    beside = known if seen.apart is None else known | (seen.apart > 1e-3 * limits.least_mm)
    near = ndimage.binary_dilation(beside, EIGHT, iterations=limits.rim_px) if beside.any() and limits.rim_px else beside
    with np.errstate(invalid="ignore"):
        off = np.abs(seen.residual - bias) > 1e-3 * limits.stray_mm + limits.noise_sigma * seen.noise_or_own
    return np.asarray(near & off)


def allowance(seen: Seen, spread: float, limits: WorldLimits) -> Float:
    """(H, W) metres by which measurement and CAD may differ beside noise."""
    beside = np.hypot(1e-3 * limits.least_mm, limits.spread_sigma * spread)
    return np.asarray(np.hypot(beside, limits.cad_sigma * np.nan_to_num(seen.cad_sigma.astype(float))))


def smooth_spread(views: Sequence[Seen], bias: Sequence[Float], limits: WorldLimits) -> float:
    """Robust standard deviation, metres, of the medians of 3 x 3 residuals over all views: multipath, rest of the bias, pose."""
    middle = []
    for seen, known in zip(views, bias, strict=True):
        error = seen.residual - known
        near = seen.in_place(limits) & np.isfinite(error) & (np.abs(error) < 1e-3 * limits.bias_most_mm)
        middle.append(_median_of(np.where(near, error, np.nan))[near].astype(np.float32))
    return robust_std(np.concatenate(middle), 0.0) if middle else 0.0


def _large(patches: Mask, least: int) -> Mask:
    """Patches of at least so many pixels."""
    number, _ = ndimage.label(patches, EIGHT)
    large = np.bincount(number.ravel()) >= least
    large[0] = False
    return np.asarray(large[number])


def _with_rim(patch: Mask, lost: Mask, saturated: Mask, rim_px: int) -> Mask:
    """A patch with the pixels without a return that it encloses, or that are near; of what is saturated near it, all."""
    if not patch.any():
        return patch
    near = ndimage.binary_dilation(patch, EIGHT, iterations=rim_px) if rim_px else patch
    rim = lost & (near | ndimage.binary_fill_holes(patch | (lost & near)))
    return np.asarray(ndimage.binary_propagation(patch | rim, structure=EIGHT, mask=patch | rim | saturated))


@numba.njit(cache=True, nogil=True)
def _medians(measured: Float, cad: Float, error: Float) -> tuple[Float, Float]:
    """Medians over 3 x 3 pixels: of the way from the range of CAD depths around a pixel to what it measured, and of the error."""
    h, w = error.shape
    beyond = np.zeros((h, w))
    for v in range(h):
        for u in range(w):
            low, high = np.inf, -np.inf
            for a in range(max(0, v - 1), min(h, v + 2)):
                for b in range(max(0, u - 1), min(w, u + 2)):
                    if np.isfinite(cad[a, b]):
                        low, high = min(low, cad[a, b]), max(high, cad[a, b])
            m = measured[v, u]
            if not np.isfinite(m) or not np.isfinite(cad[v, u]):
                beyond[v, u] = np.nan
            elif m > high:
                beyond[v, u] = m - high
            elif m < low:
                beyond[v, u] = m - low
    return _median_of(beyond), _median_of(error)


@numba.njit(cache=True, nogil=True)
def _median_of(values: Float) -> Float:
    """Median of the finite values among 3 x 3; 0 where there are none."""
    h, w = values.shape
    out = np.zeros((h, w))
    nine = np.empty(9)
    for v in range(h):
        for u in range(w):
            n = 0
            for a in range(max(0, v - 1), min(h, v + 2)):
                for b in range(max(0, u - 1), min(w, u + 2)):
                    x = values[a, b]
                    if np.isfinite(x):
                        k = n
                        while k > 0 and nine[k - 1] > x:
                            nine[k] = nine[k - 1]
                            k -= 1
                        nine[k] = x
                        n += 1
            if n > 0:
                out[v, u] = 0.5 * (nine[(n - 1) // 2] + nine[n // 2])
    return out
