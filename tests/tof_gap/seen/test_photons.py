# SPDX-License-Identifier: Apache-2.0
"""Noise by amplitude: among neighbours and between the captures of a dwell."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tests.tof_gap.quiet_views import SHAPE, SIGMA_M, VIEWS, views
from tof_gap.limits.noise import NoiseLimits
from tof_gap.seen.photons import as_captures_differ, between_ratio, binned, constant_beside_range, constant_part, fit_law, over_law
from tof_sensor.effects.photon_law import PhotonLaw
from tof_sensor.session import NoiseBins

if TYPE_CHECKING:
    from tof_gap.seen.residual import ViewEvidence

LIMITS = NoiseLimits()
CAPTURES = 4


def dwells(share: float, structure: float = 0.0) -> list[ViewEvidence]:
    """Views of four captures whose noise of `SIGMA_M` varies between captures by a `share` of its variance; `structure`: metres RMS in all captures."""
    rng = np.random.default_rng(3)
    same = structure * rng.standard_normal((VIEWS, *SHAPE))
    out = []
    for v in views(rng, same, captures=(CAPTURES,) * VIEWS):
        light = v.frame.amplitude / 2000.0
        sigma = SIGMA_M * np.sqrt(share / light / CAPTURES) / v.frame.length
        out.append(replace(v, view=replace(v.view, sigma=sigma.astype(np.float32), count=np.full(SHAPE, CAPTURES, np.uint16))))
    return out


@pytest.mark.parametrize("share", [1.0, 0.25])
def test_captures_differ_by_their_noise_over_what_a_filter_leaves(share: float) -> None:
    b = binned(dwells(share), LIMITS.bins, LIMITS)
    assert between_ratio(b) == pytest.approx(share, rel=0.05)
    assert np.median(as_captures_differ(b, between_ratio(b)).variance / b.variance) == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize("share", [1.0, 0.25])
def test_structure_that_all_captures_share_is_no_noise(share: float) -> None:
    """Beside the law of a session without structure; or by the darker half of the bins, where noise outweighs it."""
    clean, rough = (binned(dwells(share, m), LIMITS.bins, LIMITS) for m in (0.0, SIGMA_M))
    bright = clean.amplitude > np.quantile(clean.amplitude, 0.8)
    assert np.median((rough.variance / clean.variance)[bright]) > 2.0
    known = as_captures_differ(rough, between_ratio(clean))
    assert np.median((known.variance / clean.variance)[bright]) == pytest.approx(1.0, abs=0.1)
    alone = as_captures_differ(rough, between_ratio(rough))
    assert np.median((alone.variance / clean.variance)[bright]) < 0.8 * np.median((rough.variance / clean.variance)[bright])


def test_views_of_one_capture_and_an_unknown_ratio_change_nothing() -> None:
    b = binned(views(np.random.default_rng(3)), LIMITS.bins, LIMITS)
    assert between_ratio(b) == 0.0
    assert as_captures_differ(b, 0.0) is b
    np.testing.assert_array_equal(as_captures_differ(b, 0.5).variance, b.variance)


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
