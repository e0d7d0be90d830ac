# SPDX-License-Identifier: Apache-2.0
"""Charge: what the taps collect of the light, with traps, noise, converter and full well."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numba import njit

from benchmarks.emerging.waveform import STEPS

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from benchmarks.emerging.device import Device
    from benchmarks.emerging.light import Light
    from benchmarks.emerging.waveform import Response
    from tof_core.arrays import Float, Mask


@dataclass(frozen=True, slots=True, eq=False)
class Individual:
    """What differs from pixel to pixel of one camera.

    `built_s` (P,): delay of the pixel's gate as built; `aged_s` (P,): delay that came after the factory calibration;
    `gain` (2, P): gain of each tap; `pedestal` (2, P): dark offset in electrons; `telegraph` (P,): which pixels jump.
    """

    built_s: Float
    aged_s: Float
    gain: Float
    pedestal: Float
    telegraph: Mask


def individual(device: Device, shape: tuple[int, int]) -> Individual:
    """Draw the camera's individual pixels from its serial number."""
    p, (height, width) = device.pixel, shape
    rng = np.random.default_rng([device.serial, 11])
    across = (np.arange(width) / max(width - 1, 1) - 0.5)[None, :] + np.zeros(shape)
    columns, rows, pixels = rng.normal(0, 1, width), rng.normal(0, 1, height), rng.normal(0, 1, shape)
    aged = p.column_ps * columns[None, :] + p.row_ps * rows[:, None] + p.pixel_ps * pixels
    one = rng.normal(0, 1, (3, height * width))
    return Individual(
        built_s=1e-12 * p.clock_ps * across.ravel(),
        aged_s=1e-12 * aged.ravel(),
        gain=np.stack([1 + 0.5 * p.mismatch * one[0], 1 - 0.5 * p.mismatch * one[0]]),
        pedestal=p.pedestal_e * one[1:],
        telegraph=rng.random(height * width) < p.telegraph_share,
    )


@dataclass(frozen=True, slots=True, eq=False)
class Counts:
    """Converted electrons of each frequency, step and tap (F, 4, 2, P), dark offset taken off, and saturated pixels (P,)."""

    electrons: NDArray[np.float32]
    saturated: Mask


def collect(
    device: Device,
    pixels: Individual,
    taps: Response,
    lights: list[Light],
    delay_s: float,
    rng: np.random.Generator | None,
) -> Counts:
    """One capture: F times 4 sub-frames, each of its own light (or all of one).

    `delay_s` is the delay of the pulse behind the gates. Without `rng` noise and converter are left out: the mean capture.
    """
    F, P = len(taps.omega), lights[0].steady.size
    delay = delay_s - pixels.built_s - pixels.aged_s
    noise = _noise(device, pixels, (F, STEPS, 2, P), lights[0].shape, rng)
    out = np.empty((F, STEPS, 2, P), np.float32)
    full = np.zeros(P, np.bool_)
    p = device.pixel
    for f in range(F):
        turned = np.exp(-1j * taps.omega[f] * delay)
        for k in range(STEPS):
            light = lights[(f * STEPS + k) % len(lights)]
            _subframe(
                out[f, k],
                full,
                taps.orders[f, k],
                taps.steady[f],
                light.orders[f],
                light.steady,
                turned,
                light.beat(f, k),
                taps.exposure[f],
                taps.omega[f] * 1e-9 * p.trap_ns,
                1e3 * p.trap_ke,
                p.dark_e,
                pixels.gain,
                pixels.pedestal,
                noise[f, k],
                p.read_e,
                1e3 * p.full_well_ke,
                1e3 * p.full_well_ke / 2**p.adc_bits,
            )
    return Counts(out, full)


def _noise(
    device: Device, pixels: Individual, size: tuple[int, int, int, int], shape: tuple[int, int], rng: np.random.Generator | None
) -> NDArray[np.float32]:
    """Noise (F, 4, 2, 2, P): standard normal numbers for shot and read noise, and electrons of rows and telegraph pixels.

    Third axis: 0 the numbers, 1 the electrons; fourth axis: the tap. Empty without `rng`.
    """
    F, K, A, P = size
    if rng is None:
        return np.zeros((F, K, 2, A, 0), np.float32)
    out = np.zeros((F, K, 2, A, P), np.float32)
    out[:, :, 0] = rng.standard_normal((F, K, A, P), dtype=np.float32)
    p = device.pixel
    if p.row_noise_e > 0:
        rows = rng.standard_normal((F, K, A, shape[0]), dtype=np.float32)
        out[:, :, 1] += p.row_noise_e * np.repeat(rows, shape[1], axis=-1)
    if p.telegraph_e > 0:
        level = rng.integers(0, 2, (F, K, A, int(pixels.telegraph.sum())))
        out[..., 1, :, :][..., pixels.telegraph] += p.telegraph_e * (level - 0.5)
    return out


@njit(cache=True, error_model="numpy")
def _subframe(
    out: NDArray[np.float32],
    full: Mask,
    orders: NDArray[np.complex128],
    steady: Float,
    light: NDArray[np.complex128],
    constant: Float,
    turned: NDArray[np.complex128],
    beat: NDArray[np.complex128],
    exposure: float,
    released: float,
    trap: float,
    dark: float,
    gain: Float,
    pedestal: Float,
    noise: NDArray[np.float32],
    read: float,
    full_well: float,
    step: float,
) -> None:
    """Write the electrons of both taps (2, P) of one sub-frame."""
    P = constant.size
    N = orders.shape[1]
    noisy, beats = noise.shape[2] > 0, beat.size > 0
    for p in range(P):
        total = exposure * constant[p]
        # Traps hold a number of electrons, so the share that comes late falls with brightness.
        late = trap / total * (1 - math.exp(-total / trap)) if trap > 0 and total > 0 else 0.0
        z1 = turned[p]
        z2 = z1 * z1
        z = z1
        modulated = 0.0
        for n in range(N):
            if n:
                z = z * z2
            x = light[n, p] * z
            if n == 0 and beats:
                x += beat[p]
            if late > 0:
                x = x * (1 - late + late / complex(1.0, (2 * n + 1) * released))
            c = orders[0, n]
            modulated += c.real * x.real - c.imag * x.imag
        for a in range(2):
            n_e = gain[a, p] * (total * steady[a] / exposure + (modulated if a == 0 else -modulated) + dark)
            if noisy:
                n_e += math.sqrt(max(n_e, 0.0) + read * read) * noise[0, a, p] + noise[1, a, p]
            n_e += pedestal[a, p]
            if n_e >= full_well:
                n_e = full_well
                full[p] = True
            if noisy:
                n_e = math.floor(n_e / step + 0.5) * step
            out[a, p] = n_e - pedestal[a, p]
