# SPDX-License-Identifier: Apache-2.0
"""The whole camera: calibrated once at the factory, then light in, depth and amplitude out."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from benchmarks.emerging import firmware, thermal
from benchmarks.emerging.firmware import Correction, Reading
from benchmarks.emerging.light import Light
from benchmarks.emerging.taps import Individual, collect, individual
from benchmarks.emerging.waveform import ORDERS, response
from tof_virtual.effect import Frame
from tof_virtual.taps import SPEED_OF_LIGHT

if TYPE_CHECKING:
    from benchmarks.emerging.device import Device
    from benchmarks.emerging.waveform import Response
    from tof_core.arrays import Float
    from tof_core.camera import Camera as Lens

TARGET_AMBIENT_KE = 1.0
"""Ambient light of the calibration room on its target."""


class Camera:
    """One device with its factory calibration.

    Args:
        device: the camera as it is now.
        built: the same camera at the factory, before anything aged; the calibration is made with it.
        lens: the published CameraInfo, by which the firmware turns distances into z.
    """

    def __init__(self, device: Device, built: Device, lens: Lens) -> None:
        """Calibrate the factory's camera, and keep what it stored."""
        self.device, self.lens = device, lens
        self.pixels = individual(device, lens.shape)
        self.response = response(device)
        self.correction = calibrated(built, individual(built, lens.shape))
        rays = lens.rays().reshape(-1, 3)
        self._length = np.linalg.norm(rays, axis=1)
        self._unit = rays / self._length[:, None]
        self._network = thermal.Network(device.thermal)

    def thermometer(self, time_s: float) -> float:
        """What the thermometer reads, in degrees Celsius."""
        return self._network.at(time_s).thermometer

    def power(self, time_s: float) -> float:
        """Emitted power over that at the factory calibration."""
        return thermal.power(self.device, self._network.at(time_s))

    def expose(self, lights: list[Light], time_s: float, rng: np.random.Generator | None = None) -> Frame:
        """One frame. `lights`: one for all sub-frames, or one each; without `rng` the mean frame, without noise and converter."""
        warmth = self._network.at(time_s)
        delay = thermal.delay_s(self.device, warmth) + 1e-12 * self.device.lamp.delay_ps
        known = thermal.compensated_s(self.device, warmth.thermometer)
        readings = []
        for _ in range(self.device.firmware.captures if rng is not None else 1):
            counts = collect(self.device, self.pixels, self.response, lights, delay, rng)
            readings.append(firmware.read(self.device, counts, self.correction, known))
        return self._published(readings, noisy=rng is not None)

    def _published(self, readings: list[Reading], *, noisy: bool) -> Frame:
        """Mean of the internal captures, thresholds, filter, z, step."""
        d, f = self.device, self.device.firmware
        distance = np.mean([r.distance for r in readings], axis=0)
        amplitude = np.mean([r.amplitude for r in readings], axis=0)
        saturated = np.any([r.saturated for r in readings], axis=0)
        apart = np.ptp([r.distance for r in readings], axis=0)
        weak = np.min([r.amplitude for r in readings], axis=0) < f.min_amplitude_e
        distance = firmware.along_ray(d, distance, self._unit)
        valid = ~weak & ~saturated & (apart <= 1e-3 * f.agree_mm) & (distance > 0.02)
        distance = np.where(valid, distance, np.nan)
        if f.filter:
            expected = np.mean([r.noise for r in readings], axis=0) / np.sqrt(f.captures)
            distance[firmware.edges(distance, expected, self.lens.shape, 1 / self.lens.fx)] = np.nan
        if f.denoise_px > 1:
            distance = firmware.denoised(distance, self.lens.shape, f.denoise_px)
        depth = distance if f.radial else distance / self._length
        if noisy:
            step = 1e-3 * f.step_mm
            depth = np.rint(depth / step) * step
        return Frame(depth, amplitude, saturated)


def calibrated(built: Device, pixels: Individual) -> Correction:
    """The factory's two steps at the reference temperature, on a flat target of known distance.

    First the central pixel over one period of each frequency, in steps; then every pixel's delay at one distance, with noise.
    """
    taps = response(built)
    nodes = built.factory.nodes
    flat = Individual(np.zeros(nodes), np.zeros(nodes), np.ones((2, nodes)), np.zeros((2, nodes)), np.zeros(nodes, bool))
    spans = SPEED_OF_LIGHT / (2 * np.array(built.frequencies))
    cyclic = np.empty((spans.size, nodes))
    for f, span in enumerate(spans):
        truth = np.arange(nodes) / nodes * span
        cyclic[f] = _on_nodes(truth, _phase_distance(built, flat, taps, truth, f, span), span)
    rng = np.random.default_rng([built.serial, 31])
    noise = 1e-12 * built.factory.pixel_noise_ps * rng.standard_normal(pixels.built_s.size)
    return Correction(cyclic, pixels.built_s + noise)


def _phase_distance(built: Device, flat: Individual, taps: Response, truth: Float, f: int, span: float) -> Float:
    """What the uncorrected phase says of a target at each true distance (n,)."""
    light = target(truth, taps.omega, 1e3 * built.factory.target_ke, 1e3 * TARGET_AMBIENT_KE)
    electrons = collect(built, flat, taps, [light], 0.0, None).electrons[f].astype(float)
    i, q = ((electrons[k, 0] - electrons[k, 1]) - (electrons[k + 2, 0] - electrons[k + 2, 1]) for k in (0, 1))
    return np.asarray((np.arctan2(q, i) / (2 * np.pi)) % 1.0 * span)


def target(distance: Float, omega: Float, electrons: float, ambient: float) -> Light:
    """Light of a flat target at each distance (n,), equally bright everywhere."""
    orders = np.array(ORDERS)
    turns = np.exp(-2j / SPEED_OF_LIGHT * omega[:, None, None] * orders[:, None] * distance)
    return Light(np.full(distance.size, electrons + ambient), electrons * turns, (1, distance.size))


def _on_nodes(truth: Float, measured: Float, span: float) -> Float:
    """Measured minus true, brought from equally spaced true distances to equally spaced measured ones; both are periodic."""
    off = (measured - truth + 0.5 * span) % span - 0.5 * span
    middle = off.mean()
    off = (off - middle + 0.5 * span) % span - 0.5 * span + middle
    return np.asarray(np.interp(np.arange(truth.size) / truth.size * span, truth + off, off, period=span))
