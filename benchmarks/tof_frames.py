# SPDX-License-Identifier: Apache-2.0
"""Depth frames with a known truth for the filters: planes, boxes, a cylinder and posts, seen through pixel footprints.

Analytic depth on a raster several times finer is summed as phasors over each pixel, which makes flying pixels as a
continuous-wave camera makes them; photon noise, spikes and dropouts come on top.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from tof_core.camera import Camera
from tof_core.capture import Capture
from tof_core.reasons import Reason

if TYPE_CHECKING:
    from tof_core.arrays import Float, Image, Mask

CAMERA = Camera(400, 300, 377.0, 377.0, 199.5, 149.5)
MODULATION_HZ = 100e6
LIGHT = 299_792_458.0
FINE = 4
NOISE_AT_1 = 0.025
"""Noise in metres of one capture at amplitude 1, falling with the root of the amplitude (1000: 0.8 mm)."""


@dataclass(frozen=True, slots=True, eq=False)
class Truth:
    """A frame without noise: depth as footprints mix it, the nearest of the surfaces a pixel sees, and amplitude."""

    camera: Camera
    depth: Float
    surface: Float
    amplitude: Float

    @property
    def mixed(self) -> Mask:
        """Pixels that footprints put more than 3 mm off every surface they see."""
        return np.abs(self.depth - self.surface) > 3e-3


@lru_cache(maxsize=4)
def edge_rich(camera: Camera = CAMERA, boxes: int = 12, seed: int = 7) -> Truth:
    """A slanted wall and a floor, boxes at many depths, an upright cylinder, two posts of a few pixels."""
    fine = camera.scaled(FINE)
    rng = np.random.default_rng(seed)
    rays = fine.rays()
    x, y = rays[..., 0], rays[..., 1]
    depth = 1.5 / (1 + 0.3 * x)
    albedo = np.where(np.sin(40 * x) * np.sin(40 * y) > 0, 0.7, 0.25)
    floor = np.where(y > 0.05, 0.30 / np.maximum(y, 1e-6), np.inf)
    depth, albedo = _in_front(depth, albedo, floor, 0.5)
    for _ in range(boxes):
        cx, cy, z = rng.uniform(-0.5, 0.5), rng.uniform(-0.38, 0.25), rng.uniform(0.7, 1.4)
        half = rng.uniform(0.015, 0.1, 2)
        slope = rng.uniform(-0.8, 0.8, 2)
        plane = z * (1 - slope @ [cx, cy]) / (1 - slope[0] * x - slope[1] * y)
        inside = (np.abs(x - cx) < half[0]) & (np.abs(y - cy) < half[1])
        depth, albedo = _in_front(depth, albedo, np.where(inside, plane, np.inf), rng.uniform(0.08, 0.8))
    depth, albedo = _in_front(depth, albedo, _cylinder(x, centre=(0.25, 1.1), radius=0.08), 0.6)
    for at, width in ((-0.3, 3.5), (-0.25, 6.0)):
        post = np.where(np.abs(x - at) * camera.fx < width / 2, 0.8, np.inf)
        depth, albedo = _in_front(depth, albedo, post, 0.5)
    return _seen(camera, depth, 1000 * albedo / depth**2)


def plane(camera: Camera = CAMERA, incidence_deg: float = 30.0, z: float = 1.0, amplitude: float = 1000.0) -> Truth:
    """One plane through (0, 0, z), turned about y, that fills the picture; amplitude the same everywhere."""
    depth = z / (1 + np.tan(np.deg2rad(incidence_deg)) * camera.rays()[..., 0])
    return Truth(camera, depth, depth, np.full(camera.shape, amplitude))


def captures(
    truth: Truth,
    count: int = 1,
    *,
    seed: int = 0,
    noise: float = 1.0,
    spikes: float = 0.0,
    dropouts: float = 0.0,
    quantum: float = 0.0,
) -> list[Capture]:
    """Captures at 15 Hz with photon noise (times `noise`); shares of pixels thrown anywhere, or lost; codes of `quantum`."""
    rng = np.random.default_rng(seed)
    return [_capture(truth, rng, i, (noise, spikes, dropouts, quantum)) for i in range(count)]


def noise_of(truth: Truth) -> Float:
    """(H, W) standard deviation of one capture in metres."""
    return NOISE_AT_1 / np.sqrt(truth.amplitude)


def _capture(truth: Truth, rng: np.random.Generator, i: int, how: tuple[float, float, float, float]) -> Capture:
    noise, spikes, dropouts, quantum = how
    shape = truth.depth.shape
    depth = truth.depth + noise * noise_of(truth) * rng.standard_normal(shape)
    depth = np.where(rng.random(shape) < spikes, rng.uniform(0.3, 3.0, shape), depth)
    depth = np.round(depth / quantum) * quantum if quantum else depth
    lost = rng.random(shape) < dropouts
    image: Image = np.where(lost, np.nan, depth).astype(np.float32)
    amplitude = (truth.amplitude + np.sqrt(truth.amplitude) * rng.standard_normal(shape)).astype(np.float32)
    reason = np.where(lost, Reason.NO_RETURN, Reason.VALID).astype(np.uint8)
    return Capture(1_000_000_000 + round(i * 1e9 / 15), truth.camera, image, reason, amplitude=amplitude)


def _in_front(depth: Float, albedo: Float, other: Float, other_albedo: float) -> tuple[Float, Float]:
    nearer = other < depth
    return np.where(nearer, other, depth), np.where(nearer, other_albedo, albedo)


def _cylinder(x: Float, centre: tuple[float, float], radius: float) -> Float:
    """Depth of an upright cylinder whose axis stands at (x, z) = centre."""
    cx, cz = centre
    a, b, c = x**2 + 1, cx * x + cz, cx**2 + cz**2 - radius**2
    root = b**2 - a * c
    return np.where(root > 0, (b - np.sqrt(np.maximum(root, 0))) / a, np.inf)


def _seen(camera: Camera, depth: Float, amplitude: Float) -> Truth:
    """Phasor sums of the fine raster over each pixel, and the surface nearest to what they give."""
    blocks = [_blocks(a, FINE) for a in (depth, amplitude, camera.scaled(FINE).ray_length())]
    z, light, length = blocks
    phase = 4 * np.pi * MODULATION_HZ / LIGHT
    centre = z[..., FINE * FINE // 2 + FINE // 2][..., None] * length
    total = (light * np.exp(1j * phase * (z * length - centre))).mean(axis=-1)
    mixed = (np.angle(total) / phase + centre[..., 0]) / length.mean(axis=-1)
    nearest = np.abs(z - mixed[..., None]).argmin(axis=-1)
    surface = np.take_along_axis(z, nearest[..., None], axis=-1)[..., 0]
    return Truth(camera, mixed, surface, np.abs(total))


def _blocks(fine: Float, n: int) -> Float:
    height, width = fine.shape[0] // n, fine.shape[1] // n
    return fine.reshape(height, n, width, n).swapaxes(1, 2).reshape(height, width, n * n)
