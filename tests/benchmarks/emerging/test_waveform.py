# SPDX-License-Identifier: Apache-2.0
"""Waveforms in time and what the taps make of them."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.emerging.waveform import ORDERS, SAMPLES, edge_limited, gate, pulse, response, series
from tests.benchmarks.emerging.made import PERFECT, device


def test_a_driver_without_time_constants_gives_the_square_wave_and_its_series() -> None:
    wave = edge_limited(0.5, 10e-9, 0.0, 0.0)
    assert set(np.unique(wave)) == {0.0, 1.0}
    np.testing.assert_allclose(np.abs(series(wave)), 1 / (np.pi * np.array(ORDERS)), rtol=1e-4)


def test_edges_follow_their_time_constants_and_the_wave_is_periodic() -> None:
    wave = edge_limited(0.5, 10e-9, 1e-9, 2e-9)
    dt = 10e-9 / SAMPLES
    rise, fall = np.diff(wave[: SAMPLES // 2]) / dt, np.diff(wave[SAMPLES // 2 :]) / dt
    np.testing.assert_allclose(rise, (1 - wave[: SAMPLES // 2 - 1]) / 1e-9, rtol=2e-3)
    np.testing.assert_allclose(fall, -wave[SAMPLES // 2 : -1] / 2e-9, rtol=2e-3)
    assert wave[-1] * np.exp(-dt / 2e-9) == pytest.approx(wave[0], rel=1e-6)


def test_a_first_order_stage_damps_each_harmonic_as_its_transfer_function_does() -> None:
    tau, f = 0.7e-9, 100e6
    orders = np.array(ORDERS)
    got = series(edge_limited(0.5, 1 / f, tau, tau)) / series(edge_limited(0.5, 1 / f, 0.0, 0.0))
    np.testing.assert_allclose(got, 1 / (1 + 2j * np.pi * f * orders * tau), rtol=1e-2)


def test_the_driver_holds_mean_power_and_the_timing_of_the_fundamental_while_its_shape_changes() -> None:
    fast, slow = (pulse(device(lamp__rise_ns=r), 100e6) for r in (0.2, 2.0))
    for wave, coefficients in (fast, slow):
        assert wave.mean() == pytest.approx(1.0)
        assert np.angle(coefficients[0]) == pytest.approx(0.0, abs=1e-9)
    assert abs(slow[1][1]) < 0.85 * abs(fast[1][1])


def test_jitter_damps_an_order_by_its_square() -> None:
    still, shaky = (np.abs(pulse(device(lamp__jitter_ps=j), 100e6)[1]) for j in (0.0, 200.0))
    w = 2 * np.pi * 100e6 * 200e-12
    np.testing.assert_allclose(shaky / still, np.exp(-0.5 * (w * np.array(ORDERS)) ** 2), rtol=1e-9)


def test_a_leaky_gate_lets_that_share_into_the_other_tap() -> None:
    tight, leaky = response(device(pixel__leak=0.0)), response(device(pixel__leak=0.2))
    np.testing.assert_allclose(leaky.orders, 0.6 * tight.orders, rtol=1e-12)
    wave = gate(device(pixel__leak=0.2, pixel__gate_ns=0.01), 100e6)
    assert (wave.min(), wave.max()) == (pytest.approx(0.2), pytest.approx(0.8))


def test_the_two_taps_together_collect_all_light_at_every_step() -> None:
    r = response(PERFECT)
    np.testing.assert_allclose(r.orders.sum(axis=2), 0.0, atol=1e-15)
    np.testing.assert_allclose(r.steady.sum(axis=1), r.exposure)
