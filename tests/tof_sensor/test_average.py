# SPDX-License-Identifier: Apache-2.0
"""Noise after an average over neighbours within a threshold."""

from __future__ import annotations

import numpy as np
import pytest

from tof_sensor.average import averaged, before_average

WITHIN_M = 0.03
PIXELS = 25


@pytest.mark.parametrize("noise_m", [0.002, 0.008, 0.012, 0.02, 0.06])
def test_noise_after_the_average_is_that_of_drawn_pixels(noise_m: float) -> None:
    drawn = np.random.default_rng(3).normal(0.0, noise_m, (60_000, PIXELS))
    near = np.abs(drawn - drawn[:, :1]) < WITHIN_M
    expected = float(((drawn * near).sum(axis=1) / near.sum(axis=1)).std())
    found = float(np.sqrt(averaged(np.array([noise_m**2]), PIXELS, WITHIN_M)[0]))
    assert found == pytest.approx(expected, rel=0.03)


def test_far_below_the_threshold_all_pixels_are_averaged_and_far_above_it_none() -> None:
    variance = np.array([1e-4, 10.0]) ** 2
    assert averaged(variance, PIXELS, WITHIN_M) == pytest.approx(variance / [PIXELS, 1.0], rel=1e-3)


def test_the_noise_before_the_average_is_found_again() -> None:
    variance = np.geomspace(1e-3, 0.5, 50) ** 2
    assert before_average(averaged(variance, PIXELS, WITHIN_M), PIXELS, WITHIN_M) == pytest.approx(variance, rel=1e-9)
