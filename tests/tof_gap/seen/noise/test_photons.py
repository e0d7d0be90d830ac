# SPDX-License-Identifier: Apache-2.0
"""Noise by amplitude, and the photon law of it."""

from __future__ import annotations

import numpy as np
import pytest

from tof_gap.limits.noise import NoiseLimits
from tof_gap.seen.noise.photons import constant_beside_range, constant_part, fit_law, over_law, quiet_law, view_ratio
from tof_sensor.effects.photon_law import PhotonLaw
from tof_sensor.session import NoiseBins

LIMITS = NoiseLimits()


def test_noise_is_over_the_law_if_all_light_and_bright_light_show_it() -> None:
    amplitude, ones = np.linspace(1.0, 10.0, 40), np.ones(40)
    law = PhotonLaw(floor_m=0.0, shot_m=0.001, reference=1.0)
    usual = law.variance(amplitude, ones)
    dark = np.where(amplitude < 5.0, 3.0, 1.0)
    assert over_law(NoiseBins(ones, amplitude, ones, ones, 2.0 * usual, ones), law) == pytest.approx(2.0)
    assert over_law(NoiseBins(ones, amplitude, ones, ones, dark * usual, ones), law) == pytest.approx(1.0)


@pytest.mark.parametrize(("constant_m", "table"), [(0.0, 0.5), (0.001, 0.0)])
def test_noise_at_every_amplitude_is_what_a_factor_over_range_leaves(constant_m: float, table: float) -> None:
    """Near surfaces are bright. A factory table that stretches noise at near ranges looks like constant noise, and is none."""
    rng = np.random.default_rng(5)
    range_m, ones = np.repeat(np.linspace(0.4, 0.9, 20), 12), np.ones(240)
    amplitude = rng.uniform(0.3, 1.0, 240) / range_m**2
    law = PhotonLaw(floor_m=constant_m, shot_m=0.001, reference=1.0)
    variance = law.variance(amplitude, ones) * (1.0 + table * np.clip((0.7 - range_m) / 0.3, 0.0, 1.0)) ** 2
    b = NoiseBins(np.repeat(np.arange(20), 12), amplitude, range_m**2, range_m**2, variance, 2000.0 * ones)
    plain, beside = constant_part(fit_law(b, 0.0, LIMITS), 0.0), constant_beside_range(b, 0.0, LIMITS)
    assert plain > 0.0005
    if table:
        assert beside < 0.5 * plain
    else:
        assert beside == pytest.approx(constant_m, rel=0.4)


def test_manyof_one_range_are_as_noisy_as_others_there() -> None:
    """A factory table that straightens a wave of 0.39 m changes the noise over range; 2 of 36 views see one wall at a crest alone."""
    rng, many, bins, crest_m = np.random.default_rng(1), 36, 12, 1.56
    number = np.arange(many)
    lone = np.isin(number, (30, 32))
    middle = np.where(lone, crest_m, np.where(number % 2, rng.uniform(0.6, 1.0, many), rng.uniform(1.6, 2.0, many)))
    range_m = (middle[:, None] + np.where(lone, 0.02, 0.2)[:, None] * np.linspace(-1.0, 1.0, bins)).ravel()
    amplitude = 1000.0 / range_m**2 * np.exp(rng.normal(0, 0.3, many * bins))
    table = 1.0 + 0.17 * np.cos(2 * np.pi * (range_m - crest_m) / 0.39)
    usual = PhotonLaw(floor_m=0.0, shot_m=0.001, reference=1000.0).variance(amplitude, range_m**2)
    variance = usual * table * rng.chisquare(400, many * bins) / 400
    b = NoiseBins(np.repeat(number.astype(float), bins), amplitude, range_m**2, range_m**2, variance, np.full(many * bins, 2000.0))
    ratio = view_ratio(b, quiet_law(b, 0.0, many, LIMITS), many, LIMITS)
    np.testing.assert_allclose(ratio[lone], 1.0, atol=0.1)
