# SPDX-License-Identifier: Apache-2.0
"""Noise by amplitude, and the photon law of it."""

from __future__ import annotations

import numpy as np
import pytest

from tof_gap.limits.noise import NoiseLimits
from tof_gap.seen.photons import constant_beside_range, constant_part, fit_law, over_law
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
