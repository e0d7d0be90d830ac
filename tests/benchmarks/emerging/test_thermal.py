# SPDX-License-Identifier: Apache-2.0
"""The heat network: who warms when, and what the firmware makes of the thermometer."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.emerging.thermal import Network, compensated_s, delay_s, reference
from tests.benchmarks.emerging.made import device


def test_a_cold_camera_starts_at_the_air_and_ends_at_its_steady_state() -> None:
    d = device(thermal__warmup_ahead=1.0, thermal__ambient_c=20.0)
    network = Network(d.thermal)
    first, last = network.at(0.0), network.at(1e5)
    assert (first.lamp, first.sensor, first.housing, first.thermometer) == pytest.approx((20.0,) * 4)
    assert (last.lamp, last.sensor, last.housing) == pytest.approx((64.0, 46.0, 32.0))


def test_temperatures_obey_the_heat_balance() -> None:
    d = device(thermal__warmup_ahead=1.0)
    t, network = d.thermal, Network(d.thermal)
    for time in (5.0, 100.0, 1000.0):
        low, now, high = network.at(time - 0.01), network.at(time), network.at(time + 0.01)
        assert (high.lamp - low.lamp) / 0.02 == pytest.approx((t.lamp_K - (now.lamp - now.housing)) / t.lamp_s, rel=1e-4)
        assert (high.thermometer - low.thermometer) / 0.02 == pytest.approx((now.housing - now.thermometer) / t.thermometer_s, rel=1e-4)


def test_the_thermometer_lags_behind_the_lamp_by_minutes() -> None:
    d = device(thermal__warmup_ahead=1.0)
    times = np.arange(0, 7200.0, 5)
    warm = [Network(d.thermal).at(t) for t in times]

    def half_way(values: list[float]) -> float:
        level = np.array(values)
        return float(times[np.argmax(level > 0.5 * (level[0] + level[-1]))])

    assert half_way([w.thermometer for w in warm]) - half_way([w.lamp for w in warm]) > 180


def test_compensation_is_exact_when_steady_at_any_air_and_behind_during_warm_up() -> None:
    for air in (5.0, 24.0, 40.0):
        d = device(thermal__ambient_c=air)
        steady = Network(d.thermal).at(0.0)
        assert delay_s(d, steady) == pytest.approx(compensated_s(d, steady.thermometer), abs=1e-18)
    cold = device(thermal__warmup_ahead=1.0)
    left = [delay_s(cold, w) - compensated_s(cold, w.thermometer) for w in (Network(cold.thermal).at(t) for t in (0.0, 200.0, 1e5))]
    # cold, the lamp is farther below its steady state than the thermometer is: the pulse is early; then the thermometer lags
    assert left[0] < -30e-12
    assert left[1] > left[0] + 20e-12
    assert left[2] == pytest.approx(0.0, abs=1e-15)


def test_at_the_reference_nothing_is_to_compensate() -> None:
    d = device()
    assert delay_s(d, reference(d)) == 0.0
    assert compensated_s(d, reference(d).thermometer) == 0.0
