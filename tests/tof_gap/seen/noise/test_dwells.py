# SPDX-License-Identifier: Apache-2.0
"""Captures of a dwell differ by noise alone; neighbours also by structure, which captures share."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tests.tof_gap.quiet_views import SHAPE, SIGMA_M, VIEWS, views
from tof_gap.limits.noise import NoiseLimits
from tof_gap.seen.noise.dwells import as_captures_differ, between_ratio, usual_ratio
from tof_gap.seen.noise.photons import binned
from tof_sensor.effects.photon_law import PhotonLaw

if TYPE_CHECKING:
    from tof_gap.seen.evidence.view import ViewEvidence

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


@pytest.mark.filterwarnings("error")
def test_views_of_one_capture_and_an_unknown_ratio_change_nothing() -> None:
    b = binned(views(np.random.default_rng(3)), LIMITS.bins, LIMITS)
    assert between_ratio(b) == 0.0
    assert as_captures_differ(b, 0.0) is b
    assert between_ratio(b.of(b.view < 0)) == 0.0, "without a bin"
    np.testing.assert_array_equal(as_captures_differ(b, 0.5).variance, b.variance)


def test_the_ratio_of_a_stated_law_holds_where_it_has_one() -> None:
    """A data sheet written by hand has none: the session's own holds then."""
    b = binned(dwells(0.25), LIMITS.bins, LIMITS)
    assert usual_ratio(b, PhotonLaw(between=0.7)) == 0.7
    assert usual_ratio(b, PhotonLaw()) == usual_ratio(b, None) == between_ratio(b)
