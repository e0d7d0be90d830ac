# SPDX-License-Identifier: Apache-2.0
"""Noise of rows and of single pixels, which a median over pixels does not show, is compared part by part."""

from __future__ import annotations

import numpy as np
import pytest

from tests.tof_gap.diagnosed import compared, diagnosis, only
from tests.tof_gap.quiet_views import SHAPE, VIEWS, views
from tof_gap.compare.difference import LACKS, STRONG, SUPERFLUOUS
from tof_gap.compare.noise_parts import OF_PIXELS, Measured, apart, measured
from tof_gap.limits.noise import NoiseLimits

ROWS = np.random.default_rng(1).standard_normal((VIEWS, SHAPE[0], 1)) * np.ones(SHAPE)
NOISY = np.random.default_rng(2).random(SHAPE) < 0.02
PIXELS = np.random.default_rng(3).standard_normal((VIEWS, *SHAPE)) * NOISY


def of_rows(size_m: float) -> np.ndarray:
    return size_m * ROWS


@pytest.mark.parametrize(
    ("real_m", "simulated_m", "manner"),
    [(0.0, 0.003, SUPERFLUOUS), (0.003, 0.0, LACKS), (0.002, 0.004, STRONG), (0.0008, 0.002, STRONG), (0.0003, 0.004, SUPERFLUOUS)],
)
def test_noise_of_rows_is_compared_with_that_of_the_other_session(real_m: float, simulated_m: float, manner: str) -> None:
    """Noise that a row shares, beside 4 mm of a pixel, which is alike in both sessions.

    0.8 mm are too little to be named by themselves, less than a quarter of the noise of a pixel, and they are there.
    """
    real, simulated = (diagnosis(views(np.random.default_rng(5), of_rows(size))) for size in (real_m, simulated_m))
    found = compared(real, simulated)
    assert (found.verdict, only(found).simulator) == (("noise",), manner)
    sizes = [1e-3 * s for s in (only(found).real_mm, only(found).simulated_mm)]
    assert sizes == pytest.approx([real_m, simulated_m], rel=0.15, abs=3e-4)
    assert "by rows in one capture" in only(found).line()


def test_noise_of_rows_that_makes_most_of_the_noise_of_all_pixels_is_what_differs() -> None:
    """4 mm of rows beside 4 mm of a pixel: every pixel has 5.7 mm, and the difference is that of the rows."""
    found = compared(*(diagnosis(views(np.random.default_rng(5), of_rows(size))) for size in (0.0, 0.004)))
    assert "by rows in one capture" in only(found).line()
    assert (only(found).real_mm, only(found).simulated_mm) == (pytest.approx(0.0, abs=0.3), pytest.approx(4.0, rel=0.15))


def test_one_noise_of_rows_in_both_is_no_difference() -> None:
    real, simulated = (diagnosis(views(np.random.default_rng(seed), of_rows(0.003))) for seed in (5, 6))
    assert compared(real, simulated).verdict == ("none",)


def test_noise_of_single_pixels_is_compared() -> None:
    """One pixel in fifty with 20 mm of noise of its own: 20 mm times the root of a fiftieth over all pixels."""
    real, simulated = (diagnosis(views(np.random.default_rng(5), extra)) for extra in (None, 0.020 * PIXELS))
    found = compared(real, simulated)
    assert (found.verdict, only(found).simulator) == (("noise",), SUPERFLUOUS)
    assert only(found).simulated_mm == pytest.approx(20.0 * np.sqrt(NOISY.mean()), rel=0.25)
    assert f"{OF_PIXELS} in one capture" in only(found).line()


def test_few_unstable_pixels_are_compared_by_their_own_noise() -> None:
    """One pixel in fifty with 2.5 mm of its own, beside 0.6 mm of all pixels: 0.35 mm over the image."""
    quiet = 0.15 * np.random.default_rng(7).normal(0.0, 0.004, (VIEWS, *SHAPE))
    unstable = quiet + 0.0025 * PIXELS
    real, simulated = (diagnosis(views(np.random.default_rng(5), extra, photons=False)) for extra in (unstable, quiet))
    found = compared(real, simulated)
    assert (found.verdict, only(found).simulator) == (("noise",), LACKS)
    assert only(found).real_mm < NoiseLimits().extra_mm


def test_what_is_less_than_a_diagnosis_names_is_not_there() -> None:
    """0.3 mm of rows are less than 0.5 mm, and than a quarter of the noise of a pixel."""
    parts = measured(views(np.random.default_rng(5), of_rows(0.0003)), NoiseLimits())
    assert not any(part.named for part in parts.values())
    assert set(parts) == {"by rows", "by columns", OF_PIXELS}


LIGHT = np.geomspace(1000.0, 4000.0, 12)


def of_light(sizes: np.ndarray, light: np.ndarray) -> Measured:
    return Measured(float(np.sqrt(np.mean(sizes**2))), shown=True, named=True, by_view=sizes, light=light)


def test_noise_that_is_constant_in_electrons_is_no_difference_of_sessions_in_other_light() -> None:
    """Half the light makes twice the noise in metres: by the sizes alone the two sessions would differ."""
    one, other = of_light(4.0 / LIGHT, LIGHT), of_light(4.0 / (0.5 * LIGHT), 0.5 * LIGHT)
    assert not apart(one, other, 1.25, unit=1.0)
    assert apart(one, other, 1.25, unit=None)


def test_twice_the_noise_is_a_difference_in_any_light() -> None:
    one = of_light(4.0 / LIGHT, LIGHT)
    assert apart(one, of_light(16.0 / (0.5 * LIGHT), 0.5 * LIGHT), 1.25, unit=1.0)
    assert apart(one, of_light(4.0 / (2.5 * LIGHT), LIGHT), 1.25, unit=1.0)


def test_sizes_that_vary_from_view_to_view_are_no_difference() -> None:
    """A factor of 1.4 between the means of views whose sizes vary by a factor of three: half a standard error."""
    rng = np.random.default_rng(9)
    sizes = np.exp(rng.normal(0.0, 1.1, 12))
    assert not apart(of_light(sizes, LIGHT), of_light(1.4 * sizes[::-1], LIGHT), 1.25, unit=1.0)


def test_noise_that_a_session_hardly_shows_is_compared_by_its_size_alone() -> None:
    few = np.where(np.arange(12) < 2, 1e-4, 0.0)
    assert apart(of_light(few, LIGHT), of_light(4.0 / LIGHT, LIGHT), 1.25, unit=1.0)


def test_an_amplitude_in_another_unit_is_taken_into_account() -> None:
    """The simulator counts twice as much for the same light."""
    one, other = of_light(4.0 / LIGHT, LIGHT), of_light(4.0 / LIGHT, 2.0 * LIGHT)
    assert not apart(one, other, 1.25, unit=2.0)
    assert not apart(of_light(4.0 / LIGHT, LIGHT), of_light(8.0 / LIGHT, LIGHT), 1.25, unit=2.0)
