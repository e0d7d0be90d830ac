# SPDX-License-Identifier: Apache-2.0
"""Calibrated sigma covers 68 and 95 % for any tails of the errors; the limit excludes flying pixels."""

from __future__ import annotations

import numpy as np
import pytest

from tof_infer.honesty import Calibration, calibrate, coverage, sigma_limit

RNG = np.random.default_rng(5)
N = 60_000


@pytest.mark.parametrize("law", ["normal", "laplace", "student"])
@pytest.mark.parametrize("factor", [0.2, 1.0, 5.0])
def test_calibration_meets_both_shares(law: str, factor: float) -> None:
    true = np.exp(RNG.normal(-6, 0.8, N))
    unit = {"normal": RNG.normal(size=N), "laplace": RNG.laplace(scale=np.sqrt(0.5), size=N), "student": RNG.standard_t(5, N)}[law]
    error, log_scale = true * unit, np.log(true * factor)
    one, two = coverage(error, calibrate(error, log_scale).sigma(log_scale))
    # Of a Laplace law the nearest to both is 71.7 and 92.0 %.
    assert one == pytest.approx(0.68, abs=0.055)
    assert two == pytest.approx(0.95, abs=0.03)


def test_calibration_finds_a_power_law() -> None:
    true = np.exp(RNG.normal(-6, 0.8, N))
    log_scale = (np.log(true) + 3.0) / 1.3
    found = calibrate(true * RNG.normal(size=N), log_scale)
    assert found.slope == pytest.approx(1.3, abs=0.05)
    np.testing.assert_allclose(found.sigma(log_scale), true, rtol=0.1)


def test_too_few_pixels_change_nothing() -> None:
    assert calibrate(np.ones(5), np.ones(5)) == Calibration()


def test_the_limit_leaves_few_flying_pixels_wrong() -> None:
    sigma = np.exp(RNG.normal(-6, 0.8, N))
    error = sigma * RNG.normal(size=N)
    raw = np.where(RNG.uniform(size=N) < 0.1, 0.05, 1e-3)
    wrong_raw = np.abs(raw) > 0.02
    error[wrong_raw] *= 4
    limit = sigma_limit(error, raw, sigma)
    known = sigma <= limit
    left = (known & wrong_raw & (np.abs(error) > 0.01)).sum() / wrong_raw.sum()
    assert left <= 0.1 or known.mean() == pytest.approx(0.88, abs=0.01)
    assert known.mean() >= 0.879
