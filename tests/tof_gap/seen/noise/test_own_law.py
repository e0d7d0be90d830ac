# SPDX-License-Identifier: Apache-2.0
"""The photon law of a session whose camera averages over neighbours."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tof_gap.limits.noise import NoiseLimits
from tof_gap.seen.evidence.correlation import INDEPENDENT, NoiseCorrelation
from tof_gap.seen.noise.own_law import law_beside_average
from tof_sensor.effects.photon_law import PhotonLaw
from tof_sensor.session import NoiseBins

AVERAGING = NoiseCorrelation(lever=3.0, line=5.0, area=25.0, growth=1.3)
"""An average over five by five pixels."""
LAW = PhotonLaw(floor_m=0.0003, shot_m=0.0006, reference=3000.0, window_px=5, within_m=0.018)
BINS = 240


def bins(law: PhotonLaw) -> NoiseBins:
    """Noise by a law, known to a tenth, of pixels whose neighbours share it as usual."""
    rng = np.random.default_rng(2)
    amplitude, range2 = np.geomspace(200.0, 20_000.0, BINS), np.ones(BINS)
    variance = law.variance(amplitude, range2) * np.exp(rng.normal(0.0, 0.1, BINS))
    growth = np.full(BINS, AVERAGING.growth)
    return NoiseBins(np.resize(np.arange(12.0), BINS), amplitude, range2, range2, variance, np.full(BINS, 2000.0), growth=growth)


def test_the_threshold_of_the_average_is_found_where_noise_reaches_it() -> None:
    found = law_beside_average(bins(LAW), 0.0, AVERAGING, NoiseLimits())
    assert found.within_m == pytest.approx(LAW.within_m, rel=0.2)
    assert found.window_px == LAW.window_px
    dark = np.array([250.0, 1000.0])
    assert found.variance(dark, np.ones(2)) == pytest.approx(LAW.variance(dark, np.ones(2)), rel=0.25)


def test_no_threshold_where_noise_stays_below_it_or_neighbours_share_none() -> None:
    quiet = replace(LAW, shot_m=0.0001)
    assert law_beside_average(bins(quiet), 0.0, AVERAGING, NoiseLimits()).within_m == 0.0
    assert law_beside_average(bins(LAW), 0.0, INDEPENDENT, NoiseLimits()).within_m == 0.0
