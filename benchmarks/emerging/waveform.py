# SPDX-License-Identifier: Apache-2.0
"""The lamp's pulse and the pixel's gate as waveforms in time, and what a tap collects of light with a given delay.

A tap collects the integral of pulse(t - delay) * gate(t - step / 4 period) over time. Both waveforms are periodic, so the
integral is a Fourier series in the delay; `Response` holds its coefficients. Even orders cancel in the difference of steps half
a period apart; the odd ones up to the seventh are kept.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from benchmarks.emerging.device import Device
    from tof_core.arrays import Float

ORDERS = (1, 3, 5, 7)
SAMPLES = 4096
"""Samples of one modulation period."""
STEPS = 4
"""Gate delays, a quarter period apart."""


@dataclass(frozen=True, slots=True, eq=False)
class Response:
    """What the two taps collect of light: at frequency f, step k, tap a.

    `steady` (F, 2): share of constant light, times exposure. `orders` (F, 4, 2, N): complex share of the light's phasor of each
    order, times exposure; the charge is the real part of their product. `omega` (F,): true angular frequency in rad/s.
    `exposure` (F,): exposure over that of the first frequency.
    """

    steady: Float
    orders: NDArray[np.complex128]
    omega: Float
    exposure: Float


def edge_limited(duty: float, period_s: float, rise_s: float, fall_s: float) -> Float:
    """One period (SAMPLES,) of a square wave after a stage that charges with `rise_s` and discharges with `fall_s`.

    The steady state of y' = (u - y) / tau, where tau depends on whether the input u is on. Turned on at sample 0.
    """
    t = np.arange(SAMPLES) / SAMPLES * period_s
    on = duty * period_s

    def decay(time: Float | float, tau: float) -> Float:
        return np.exp(-np.asarray(time) / tau) if tau > 0 else np.zeros(np.shape(time))

    up, down = float(decay(on, rise_s)), float(decay(period_s - on, fall_s))
    start = (1 - up) * down / (1 - up * down)
    top = 1 - (1 - start) * up
    return np.where(t < on, 1 - (1 - start) * decay(t, rise_s), top * decay(t - on, fall_s))


def series(wave: Float) -> NDArray[np.complex128]:
    """Fourier coefficients of ORDERS of one period."""
    return np.asarray(np.fft.fft(wave)[list(ORDERS)] / SAMPLES)


def pulse(device: Device, frequency: float) -> tuple[Float, NDArray[np.complex128]]:
    """Emitted power over one period (mean 1), and its coefficients with jitter.

    The driver's feedback loop holds the mean power and the timing of the fundamental, so that a slower driver changes the shape.
    """
    lamp = device.lamp
    wave = edge_limited(lamp.duty, 1 / frequency, 1e-9 * lamp.rise_ns, 1e-9 * lamp.fall_ns)
    wave /= wave.mean()
    orders = np.array(ORDERS)
    coefficients = series(wave)
    locked = np.exp(-1j * orders * np.angle(coefficients[0]))
    blurred = np.exp(-0.5 * (2 * np.pi * frequency * orders * 1e-12 * lamp.jitter_ps) ** 2)
    return wave, coefficients * locked * blurred


def gate(device: Device, frequency: float) -> Float:
    """Share of the charge that goes to tap A over one period; tap B gets the rest."""
    pixel = device.pixel
    wave = edge_limited(0.5, 1 / frequency, 1e-9 * pixel.gate_ns, 1e-9 * pixel.gate_ns)
    return pixel.leak + (1 - 2 * pixel.leak) * wave


def response(device: Device) -> Response:
    """Coefficients of both taps at every frequency and step."""
    orders = np.array(ORDERS)
    exposure = [1.0, device.clock.weight2, device.clock.weight2]
    steady, coefficients, omega = [], [], []
    for f, nominal in enumerate(device.frequencies):
        frequency = nominal * (1 + 1e-6 * device.clock.pll_ppm)
        _, emitted = pulse(device, frequency)
        open_a = gate(device, frequency)
        a = series(open_a)
        steps = np.exp(0.5j * np.pi * np.arange(STEPS)[:, None] * orders)
        of_a = 2 * emitted * a.conj() * steps
        steady.append([exposure[f] * open_a.mean(), exposure[f] * (1 - open_a.mean())])
        coefficients.append(exposure[f] * np.stack([of_a, -of_a], axis=1))
        omega.append(2 * np.pi * frequency)
    return Response(np.array(steady), np.array(coefficients), np.array(omega), np.array(exposure[: len(omega)]))
