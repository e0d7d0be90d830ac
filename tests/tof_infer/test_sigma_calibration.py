# SPDX-License-Identifier: Apache-2.0
"""Calibrated sigma covers 68 and 95 % for any tails of the errors; the limit excludes flying pixels."""

from __future__ import annotations

import numpy as np
import pytest

from tof_infer.sigma_calibration import BINS, LEAST_CORRECTED, LEFT_WRONG, Calibration, _best_shift, calibrate, coverage, sigma_limit

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


@pytest.mark.parametrize(("wrong_at", "known"), [(0.97, 0.97), (0.92, 0.92), (0.5, LEAST_CORRECTED)])
def test_the_limit_leaves_few_flying_pixels_wrong(wrong_at: float, known: float) -> None:
    """Flying pixels are right up to a quantile of sigma and wrong beyond it: the limit lies just there, but never below `LEAST_CORRECTED`."""
    sigma = np.linspace(1e-3, 1e-1, N)
    flying = np.arange(N) % 10 == 0
    raw = np.where(flying, 0.021, 0.019)
    wrong = np.arange(N) >= wrong_at * N
    error = np.where(wrong, 0.0101, 0.0099)
    share = float((sigma <= sigma_limit(error, raw, sigma)).mean())
    left = (flying & wrong & (sigma <= sigma_limit(error, raw, sigma))).sum() / flying.sum()
    allowed = LEFT_WRONG if known > LEAST_CORRECTED else 1.0
    assert left <= allowed
    assert share == pytest.approx(max(min(wrong_at + LEFT_WRONG, 1.0), LEAST_CORRECTED), abs=2e-3)


def test_pixels_that_were_not_flying_do_not_lower_the_limit() -> None:
    sigma = np.linspace(1e-3, 1e-1, N)
    assert sigma_limit(np.full(N, 0.5), np.full(N, 0.0199), sigma) == sigma[-1]
    assert sigma_limit(np.full(N, 0.5), np.full(N, -0.0201), sigma) == pytest.approx(sigma[int(LEAST_CORRECTED * N) - 1])


def test_shares_are_counted_up_to_the_sigma_itself() -> None:
    one = np.array([-1.0, 1.0, 2.0, -2.0, 2.1])
    assert coverage(one, np.ones(5)) == (0.4, 0.8)


def in_bins(log_error: np.ndarray, step: float = 0.1) -> Calibration:
    """The calibration of 20 pixels in each bin, all with one scale and one error: `log_error` (BINS,)."""
    return calibrate(np.repeat(np.exp(log_error), 20), np.repeat(step * np.arange(BINS), 20))


def test_the_slope_is_fitted_to_all_bins_but_the_outermost() -> None:
    at = 0.1 * np.arange(BINS)
    log_error = 0.8 * at
    log_error[[0, -1]] += 9.0  # the outermost
    log_error[[1, -2]] += (1.0, -2.0)  # and their neighbours, which count
    assert in_bins(log_error).slope == pytest.approx(np.polyfit(at[1:-1], log_error[1:-1], 1)[0], abs=1e-9)


def test_bins_of_19_pixels_are_not_fitted() -> None:
    at = np.repeat(0.1 * np.arange(BINS), 19)
    assert calibrate(np.exp(2.0 * at), at) == Calibration()


@pytest.mark.parametrize(("power", "slope"), [(0.2, 0.5), (0.7, 0.7), (1.2, 1.2), (2.2, 1.5)])
def test_the_slope_stays_between_a_half_and_one_and_a_half(power: float, slope: float) -> None:
    assert in_bins(power * 0.1 * np.arange(BINS)).slope == pytest.approx(slope, abs=1e-6)


@pytest.mark.parametrize(("spread", "slope"), [(0.09, 1.0), (0.11, 1.4)])
def test_scales_that_are_nearly_all_the_same_give_no_slope(spread: float, slope: float) -> None:
    """The medians of the bins span 39 steps."""
    step = spread / (BINS - 3)
    assert in_bins(1.4 * step * np.arange(BINS), step).slope == pytest.approx(slope, abs=1e-4)


def test_errors_of_zero_give_a_finite_sigma() -> None:
    found = in_bins(np.full(BINS, -np.inf))
    assert np.isfinite(found.sigma(np.zeros(1))).all()


def test_pixels_whose_own_scale_is_large_do_not_count() -> None:
    """An eighth of all pixels is five times worse than its scale says; its own scale tells it, so the factor is that of the others."""
    n = 10_000
    error, log_scale = np.abs(RNG.normal(size=n)), np.zeros(n)
    bad = np.arange(n) % 8 == 0
    error[bad] *= 5.0
    found = calibrate(error, log_scale, own=np.where(bad, 1.0, 0.0))
    one, two = coverage(error[~bad], found.sigma(log_scale[~bad]))
    assert one == pytest.approx(0.6827, abs=0.02)
    assert two == pytest.approx(0.9545, abs=0.02)


AT = float(np.exp(0.295))
"""A ratio that is within one at the shift 0.30, and not at 0.29."""


@pytest.mark.parametrize(
    ("ratios", "shares"),
    [
        ((AT, 2 * AT, 9.0), (6827, 2718, 455)),  # both shares are met there
        ((0.1, AT, 1.5, 9.0), (3000, 3827, 2718, 455)),  # before, the share within one is too small
        ((0.1, 2 * AT, 9.0), (6827, 2718, 455)),  # before, the share within two is too small
    ],
)
def test_the_factor_meets_both_shares_to_a_hundredth(ratios: tuple[float, ...], shares: tuple[int, ...]) -> None:
    assert _best_shift(np.repeat(ratios, shares)) == pytest.approx(0.30, abs=1e-9)


@pytest.mark.parametrize(("factor", "shift"), [(0.1, -0.7), (10.0, 0.7)])
def test_the_factor_is_two_at_most(factor: float, shift: float) -> None:
    assert _best_shift(factor * np.abs(RNG.normal(size=2000))) == pytest.approx(shift, abs=1e-9)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
@pytest.mark.parametrize(("raw", "error", "limited"), [(0.0201, 0.0101, True), (0.02, 0.0101, False), (0.0201, 0.01, False)])
def test_flying_is_beyond_20_mm_and_wrong_beyond_10(sign: float, raw: float, error: float, *, limited: bool) -> None:
    sigma = np.linspace(1e-3, 1e-1, 1000)
    found = sigma_limit(np.full(1000, sign * error), np.full(1000, sign * raw), sigma)
    assert found == (sigma[int(LEAST_CORRECTED * 1000) - 1] if limited else sigma[-1])


def test_of_two_pixels_one_is_corrected() -> None:
    assert sigma_limit(np.full(2, 0.5), np.full(2, 0.5), np.array([0.02, 0.01])) == 0.01
