# SPDX-License-Identifier: Apache-2.0
"""Pixels of one view whose measured depth contradicts the CAD.

A patch starts where the median of 3 x 3 pixels is outside the range of CAD depths within one pixel, which tolerates poses that are
off by a pixel and mixed pixels. It grows over neighbours with smaller deviations. Pixels at its rim have no return, since the camera
filters mixed pixels. The median averages noise; smooth errors of the sensor are subtracted before (`bias`).
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
"""The eight neighbours of a pixel."""


def contradictions(seen: Seen, bias: Float, spread: float, limits: WorldLimits) -> tuple[Mask, Mask]:
    """(H, W) pixels measured before the CAD, and behind it; pixels without a return at a patch's rim belong to the patch.

    Args:
        seen: the view.
        bias: (H, W) sensor error in z, metres.
        spread: standard deviation of the smooth part of the session's residuals without the bias, metres (`smooth_spread`).
        limits: allowed deviations.
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
    """(H, W) single deviating pixels beside a contradiction `known` (H, W), or beside a part that is off its CAD.

    The outline of a displaced part is a strip of one or two pixels, too narrow for a patch, and within the range of CAD depths beside
    it.
    """
    beside = known if seen.apart is None else known | (seen.apart > 1e-3 * limits.least_mm)
    near = ndimage.binary_dilation(beside, EIGHT, iterations=limits.rim_px) if beside.any() and limits.rim_px else beside
    if not near.any():
        return np.asarray(near)
    with np.errstate(invalid="ignore"):
        off = np.abs(seen.residual - bias) > 1e-3 * limits.stray_mm + limits.noise_sigma * seen.noise_or_own
    return np.asarray(near & off)


def allowance(seen: Seen, spread: float, limits: WorldLimits) -> Float:
    """(H, W) allowed difference of measurement and CAD in addition to noise, metres."""
    beside = np.hypot(1e-3 * limits.least_mm, limits.spread_sigma * spread)
    return np.asarray(np.hypot(beside, limits.cad_sigma * np.nan_to_num(seen.cad_sigma.astype(float))))


def smooth_spread(views: Sequence[Seen], bias: Sequence[Float], limits: WorldLimits) -> float:
    """Robust standard deviation, metres, of the medians of 3 x 3 residuals over all views, due to multipath, remaining bias and pose."""
    middle = []
    for seen, known in zip(views, bias, strict=True):
        error = seen.residual - known
        near = seen.in_place(limits) & np.isfinite(error) & (np.abs(error) < 1e-3 * limits.bias_most_mm)
        middle.append(_median_of(np.where(near, error, np.nan))[near].astype(np.float32))
    return robust_std(np.concatenate(middle), 0.0) if middle else 0.0


def _large(patches: Mask, least: int) -> Mask:
    """The patches with at least `least` pixels."""
    number, _ = ndimage.label(patches, EIGHT)
    large = np.bincount(number.ravel()) >= least
    large[0] = False
    return np.asarray(large[number])


def _with_rim(patch: Mask, lost: Mask, saturated: Mask, rim_px: int) -> Mask:
    """A patch with the pixels without a return that are enclosed or near, and connected saturated pixels."""
    if not patch.any():
        return patch
    near = ndimage.binary_dilation(patch, EIGHT, iterations=rim_px) if rim_px else patch
    rim = lost & (near | ndimage.binary_fill_holes(patch | (lost & near)))
    return np.asarray(ndimage.binary_propagation(patch | rim, structure=EIGHT, mask=patch | rim | saturated))


@numba.njit(cache=True, nogil=True)
def _medians(measured: Float, cad: Float, error: Float) -> tuple[Float, Float]:
    """Medians over 3 x 3 pixels: of the distance of a measurement from the range of CAD depths around its pixel, and of the error."""
    h, w = error.shape
    beyond, low, high = np.zeros((h, w)), np.empty(w), np.empty(w)
    for v in range(h):
        up, down = max(v - 1, 0), min(v + 1, h - 1)
        for u in range(w):
            a, b, c = cad[up, u], cad[v, u], cad[down, u]
            low[u] = min(a if np.isfinite(a) else np.inf, b if np.isfinite(b) else np.inf, c if np.isfinite(c) else np.inf)
            high[u] = max(a if np.isfinite(a) else -np.inf, b if np.isfinite(b) else -np.inf, c if np.isfinite(c) else -np.inf)
        for u in range(w):
            left, right, m = max(u - 1, 0), min(u + 1, w - 1), measured[v, u]
            least, most = min(low[left], low[u], low[right]), max(high[left], high[u], high[right])
            if not np.isfinite(m) or not np.isfinite(cad[v, u]):
                beyond[v, u] = np.nan
            elif m > most:
                beyond[v, u] = m - most
            elif m < least:
                beyond[v, u] = m - least
    return _median_of(beyond), _median_of(error)


@numba.njit(cache=True, nogil=True)
def _median_of(values: Float) -> Float:
    """Median of the finite values among 3 x 3; 0 where there are none."""
    h, w = values.shape
    out, low, middle, high, nine, whole = np.zeros((h, w)), np.empty(w), np.empty(w), np.empty(w), np.empty(9), np.empty(w, np.bool_)
    for v in range(h):
        up, down = max(v - 1, 0), min(v + 1, h - 1)
        for u in range(w):  # three rows sorted, column by column
            a, b, c = values[up, u], values[v, u], values[down, u]
            least, most = min(a, b), max(a, b)
            low[u], middle[u], high[u] = min(least, c), max(least, min(most, c)), max(most, c)
            whole[u] = np.isfinite(a) & np.isfinite(b) & np.isfinite(c)
        for u in range(1, w - 1):
            of_low = max(low[u - 1], low[u], low[u + 1])
            of_high = min(high[u - 1], high[u], high[u + 1])
            a, b, c = middle[u - 1], middle[u], middle[u + 1]
            of_middle = max(min(a, b), min(max(a, b), c))
            out[v, u] = max(min(of_low, of_middle), min(max(of_low, of_middle), of_high))
        inner = 0 < v < h - 1
        for u in range(w):
            if not (inner and 0 < u < w - 1 and whole[u - 1] and whole[u] and whole[u + 1]):
                out[v, u] = _median_of_known(values, v, u, nine)
    return out


@numba.njit(cache=True, nogil=True)
def _median_of_known(values: Float, v: int, u: int, nine: Float) -> float:
    """Median of the finite values among 3 x 3 around a pixel; 0 where there are none. `nine`: scratch memory."""
    h, w = values.shape
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
    return 0.5 * (nine[(n - 1) // 2] + nine[n // 2]) if n else 0.0
