# SPDX-License-Identifier: Apache-2.0
"""Calibrated sigma covers 68 and 95 % for any tails of the errors; the limit excludes flying pixels."""

from __future__ import annotations

import numpy as np
import pytest

from tof_infer.honesty import KNOWN, LEFT_WRONG, Calibration, calibrate, coverage, sigma_limit

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


@pytest.mark.parametrize(("wrong_at", "known"), [(0.97, 0.97), (0.92, 0.92), (0.5, KNOWN)])
def test_the_limit_leaves_few_flying_pixels_wrong(wrong_at: float, known: float) -> None:
    """Flying pixels are right up to a quantile of sigma and wrong beyond it: the limit lies just there, but never below `KNOWN`."""
    sigma = np.linspace(1e-3, 1e-1, N)
    flying = np.arange(N) % 10 == 0
    raw = np.where(flying, 0.021, 0.019)
    wrong = np.arange(N) >= wrong_at * N
    error = np.where(wrong, 0.0101, 0.0099)
    share = float((sigma <= sigma_limit(error, raw, sigma)).mean())
    left = (flying & wrong & (sigma <= sigma_limit(error, raw, sigma))).sum() / flying.sum()
    allowed = LEFT_WRONG if known > KNOWN else 1.0
    assert left <= allowed
    assert share == pytest.approx(max(min(wrong_at + LEFT_WRONG, 1.0), KNOWN), abs=2e-3)


def test_pixels_that_were_not_flying_do_not_lower_the_limit() -> None:
    sigma = np.linspace(1e-3, 1e-1, N)
    assert sigma_limit(np.full(N, 0.5), np.full(N, 0.0199), sigma) == sigma[-1]
    assert sigma_limit(np.full(N, 0.5), np.full(N, -0.0201), sigma) == pytest.approx(sigma[int(KNOWN * N) - 1])
