# SPDX-License-Identifier: Apache-2.0
"""What a maker's data sheet states: the noise of single captures of flat targets, by amplitude and distance."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.emerging.camera import Camera
from benchmarks.emerging.light import SIGNAL_RANGE_M, Light
from benchmarks.emerging.waveform import ORDERS
from tof_core.camera import Camera as Lens
from tof_virtual.taps import SPEED_OF_LIGHT

if TYPE_CHECKING:
    from benchmarks.emerging.device import Device
    from tof_core.arrays import Float

DISTANCES_M = (0.4, 0.6, 0.9, 1.3, 1.9, 2.6)
"""Distances of the targets."""
ALBEDOS = (0.1, 0.2, 0.4, 0.8)
"""Albedos of the targets."""
CAPTURES = 60
"""Captures of each target: with the target's pixels, variances to 1 %."""
SIDE_PX = 20
"""Side of the square of pixels that sees a target."""

MEASURED = 0.9
"""Share of a target's pixels, and of each one's captures, without which the target is too dark for the camera."""


@dataclass(frozen=True, slots=True, eq=False)
class NoiseTable:
    """Targets that the camera measures: mean amplitude in its unit, distance in metres, variance along the ray in m^2; each (n,).

    The variance is that of the step of the depth output at least: a near, bright target has one depth code in all captures, and no
    maker states that such a camera has no noise.
    """

    amplitude: Float
    distance: Float
    variance: Float


def noise_table(healthy: Device, lens: Lens) -> NoiseTable:
    """Noise of the camera when it is delivered, in the ambient light of the place where it will stand, through its own lens.

    Behind a lens of other pixel angles, the camera's edge filter would take the noise of dark targets for edges, or edges for noise.
    """
    lens = Lens(SIDE_PX, SIDE_PX, lens.fx, lens.fy, 0.5 * SIDE_PX, 0.5 * SIDE_PX)
    camera = Camera(healthy, healthy, lens)
    rng = np.random.default_rng([healthy.serial, 17])
    rows = [_row(camera, distance, albedo, rng) for distance in DISTANCES_M for albedo in ALBEDOS]
    return NoiseTable(*np.array([row for row in rows if row is not None]).T)


def _row(camera: Camera, distance: float, albedo: float, rng: np.random.Generator) -> tuple[float, float, float] | None:
    """Amplitude, distance and variance of one target; None where the camera gives no depth of most pixels."""
    w, bright = camera.device.world, albedo / 0.5
    own = np.full(SIDE_PX**2, 1e3 * w.signal_ke * bright * (SIGNAL_RANGE_M / distance) ** 2)
    turns = np.exp(-2j / SPEED_OF_LIGHT * camera.response.omega[:, None, None] * np.array(ORDERS)[:, None] * distance)
    light = Light(own + 1e3 * w.ambient_ke * bright, own * turns, (SIDE_PX, SIDE_PX))
    frames = [camera.expose([light], 0.0, rng) for _ in range(CAPTURES)]
    depth = np.stack([f.depth.ravel() for f in frames])
    seen = np.isfinite(depth).mean(axis=0) > MEASURED
    if seen.mean() < MEASURED:
        return None
    amplitude = np.mean([f.amplitude.ravel()[seen] for f in frames])
    of_step = (1e-3 * camera.device.firmware.step_mm) ** 2 / 12
    return float(amplitude), distance, max(float(np.median(np.nanvar(depth[:, seen], axis=0, ddof=1))), of_step)
