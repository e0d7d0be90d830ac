# SPDX-License-Identifier: Apache-2.0
"""From converted taps to what the camera publishes: phases, corrections, unwrapping, merging, z, validity."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numba import njit

from tof_virtual.taps import SPEED_OF_LIGHT

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from benchmarks.emerging.device import Device
    from benchmarks.emerging.taps import Counts
    from tof_core.arrays import Float, Mask

EDGE_SLOPE = 9.4
"""Rise over two pixels, in pixel pitches, beyond which the filter takes a 3 x 3 neighbourhood for an edge: tan 78 degrees, twice."""
STEP_SIGMAS = 10.0
"""Rise across a pixel, beyond what the slopes on either side explain, in standard deviations of one pixel, that is a step.

Of means over three rows: sigma / sqrt 3 * sqrt 10 is 1.8 sigma, so that a plane exceeds it in one of ten million pixels.
"""
STEP_LEAST_M = 0.03
"""Least step of the flying-pixel filter: one that took steps of a centimetre for edges would remove what fixed patterns leave."""


@dataclass(frozen=True, slots=True, eq=False)
class Correction:
    """What the factory stored: `cyclic` (F, n) metres to take off by phase, `pixel_s` (P,) delay of each pixel."""

    cyclic: Float
    pixel_s: Float


@dataclass(frozen=True, slots=True, eq=False)
class Reading:
    """One internal capture: distance along the ray (P,) and its expected noise in metres, amplitude (P,) in electrons, saturated (P,)."""

    distance: Float
    noise: Float
    amplitude: Float
    saturated: Mask


def read(device: Device, counts: Counts, correction: Correction, thermal_s: float) -> Reading:
    """Phases of the frequencies, corrected, unwrapped and merged. `thermal_s` is the delay that the thermometer stands for."""
    nominal = np.array(device.frequencies)
    span = SPEED_OF_LIGHT / (2 * nominal)
    exposure = np.array([1.0, device.clock.weight2, device.clock.weight2])[: nominal.size]
    weight = (nominal * exposure) ** 2 / exposure  # inverse variance of shot noise
    delay = 0.5 * SPEED_OF_LIGHT * (thermal_s - correction.pixel_s)
    distance, amplitude = _decode(counts.electrons, span, weight, correction.cyclic, delay, device.firmware.range_m)
    # shot noise of the taps' own sum at the first frequency; further frequencies average it
    total = np.maximum(counts.electrons[0, 0].sum(axis=0), 1.0)
    noise = span[0] / (2 * np.pi) * np.sqrt(2 * total) / (4 * np.maximum(amplitude, 1.0)) / np.sqrt(nominal.size)
    return Reading(distance, noise, amplitude, counts.saturated)


@njit(cache=True, error_model="numpy")
def _decode(electrons: NDArray[np.float32], span: Float, weight: Float, cyclic: Float, delay: Float, reach: float) -> tuple[Float, Float]:
    F, P = electrons.shape[0], electrons.shape[3]
    nodes = cyclic.shape[1]
    distance, amplitude = np.empty(P), np.empty(P)
    single = np.empty(F)
    for p in range(P):
        for f in range(F):
            i = (electrons[f, 0, 0, p] - electrons[f, 0, 1, p]) - (electrons[f, 2, 0, p] - electrons[f, 2, 1, p])
            q = (electrons[f, 1, 0, p] - electrons[f, 1, 1, p]) - (electrons[f, 3, 0, p] - electrons[f, 3, 1, p])
            share = (np.arctan2(q, i) / (2 * np.pi)) % 1.0
            at = share * nodes
            k = int(at) % nodes
            off = cyclic[f, k] + (at - int(at)) * (cyclic[f, (k + 1) % nodes] - cyclic[f, k])
            single[f] = (share * span[f] - off - delay[p]) % span[f]
            if f == 0:
                amplitude[p] = 0.25 * np.sqrt(float(i) ** 2 + float(q) ** 2)
        best, least = 0.0, np.inf
        for turn in range(int(np.ceil(reach / span[0]))):
            first = single[0] + turn * span[0]
            total, merged, cost = weight[0], weight[0] * first, 0.0
            for f in range(1, F):
                d = single[f] + np.round((first - single[f]) / span[f]) * span[f]
                cost += weight[f] * (d - first) ** 2
                merged += weight[f] * d
                total += weight[f]
            if cost < least and merged < reach * total:
                best, least = merged / total, cost
        distance[p] = best
    return distance, amplitude


def along_ray(device: Device, distance: Float, rays: Float) -> Float:
    """Distance (P,) from the lens along the unit `rays` (P, 3), given half the way lamp to surface to lens.

    The lamp stands where the firmware has it: |r u - b| + r = 2 d gives r = (4 d^2 - b^2) / (4 d - 2 b.u).
    """
    b = 1e-3 * device.lamp.baseline_mm
    return np.asarray((4 * distance**2 - b**2) / (4 * distance - 2 * b * rays[:, 0]))


def edges(distance: Float, noise: Float, shape: tuple[int, int], pitch: float) -> Mask:
    """Pixels (P,) between two surfaces: the flying-pixel filter.

    Edges are where a 3 x 3 neighbourhood spans more depth than a surface would, and where the depth rises by more than the
    slopes on either side and the `noise` (P,) explain. `pitch` is the angle of a pixel in radians; NaN is no neighbour.
    """
    image, sigma = (np.ascontiguousarray(a.reshape(shape)) for a in (distance, noise))
    steps = _steps(image, sigma, STEP_SIGMAS, STEP_LEAST_M)
    steps |= _steps(np.ascontiguousarray(image.T), np.ascontiguousarray(sigma.T), STEP_SIGMAS, STEP_LEAST_M).T
    return np.asarray((_spans(image, EDGE_SLOPE * pitch) | steps).ravel())


def denoised(distance: Float, shape: tuple[int, int], window: int) -> Float:
    """Distances (P,), each the mean of those in a window of `window` pixels that lie on its own surface; NaN stays NaN."""
    return np.asarray(_averaged(np.ascontiguousarray(distance.reshape(shape)), window // 2, STEP_LEAST_M).ravel())


@njit(cache=True, error_model="numpy")
def _averaged(distance: Float, reach: int, step: float) -> Float:
    """Mean over the neighbours that differ by less than `step` metres, taken in pairs opposite each other so that slopes stay."""
    H, W = distance.shape
    out = np.full((H, W), np.nan)
    for v in range(H):
        for u in range(W):
            own = distance[v, u]
            if np.isnan(own):
                continue
            total, count = own, 1
            for dv in range(reach + 1):
                for du in range(-reach, reach + 1):
                    if (dv == 0 and du <= 0) or min(v - dv, u - abs(du)) < 0 or v + dv >= H or u + abs(du) >= W:
                        continue
                    one, other = distance[v + dv, u + du] - own, distance[v - dv, u - du] - own
                    if abs(one + other) < step and abs(one - other) < 4 * step:  # false where a neighbour is NaN
                        total += 2 * own + one + other
                        count += 2
            out[v, u] = total / count
    return out


@njit(cache=True, error_model="numpy")
def _spans(distance: Float, slope: float) -> Mask:
    H, W = distance.shape
    out = np.zeros((H, W), np.bool_)
    for v in range(H):
        for u in range(W):
            low, high = np.inf, -np.inf
            for y in range(max(v - 1, 0), min(v + 2, H)):
                for x in range(max(u - 1, 0), min(u + 2, W)):
                    d = distance[y, x]
                    if not np.isnan(d):
                        low, high = min(low, d), max(high, d)
            out[v, u] = high - low > slope * distance[v, u]
    return out


@njit(cache=True, error_model="numpy")
def _steps(distance: Float, noise: Float, sigmas: float, least: float) -> Mask:
    """Steps along rows, of means over three rows."""
    H, W = distance.shape
    out = np.zeros((H, W), np.bool_)
    for v in range(1, H - 1):
        for u in range(2, W - 2):
            a, b, c, d = 0.0, 0.0, 0.0, 0.0
            for y in range(v - 1, v + 2):
                a += distance[y, u - 2] / 3
                b += distance[y, u - 1] / 3
                c += distance[y, u + 1] / 3
                d += distance[y, u + 2] / 3
            low, high = 2 * min(b - a, d - c), 2 * max(b - a, d - c)
            beyond = max(c - b - high, low - (c - b))
            out[v, u] = beyond > max(sigmas * noise[v, u], least)  # false where a neighbour is NaN
    return out
