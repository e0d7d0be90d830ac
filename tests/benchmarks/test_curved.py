# SPDX-License-Identifier: Apache-2.0
"""Errors that are grafted onto healthy sessions: each depends on its observable alone, and has a name."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.curved import KINDS, Seen, spans

RNG = np.random.default_rng(3)
SEEN = [Seen(RNG.uniform(0.4, 1.6, (20, 30)), RNG.uniform(10.0, 4000.0, (20, 30)), 15.0 * k) for k in range(20)]


@pytest.mark.parametrize("kind", KINDS)
def test_a_curve_is_finite_and_varies_over_the_session(kind: str) -> None:
    curve, effect = KINDS[kind]
    drawn = curve(np.random.default_rng(5), spans(SEEN))
    error = np.stack([drawn(s) for s in SEEN])
    assert error.shape == (20, 20, 30)
    assert np.isfinite(error).all()
    assert error.std() > 0
    assert effect in {"amplitude_bias", "temperature_drift", "wiggling"}


@pytest.mark.parametrize("kind", [k for k, (_, effect) in KINDS.items() if effect == "temperature_drift" and k != "drifting clock"])
def test_a_course_of_time_is_one_number_in_a_view(kind: str) -> None:
    drawn = KINDS[kind][0](np.random.default_rng(5), spans(SEEN))
    assert all(np.ptp(drawn(s)) == 0.0 for s in SEEN)


@pytest.mark.parametrize("kind", [k for k, (_, effect) in KINDS.items() if effect == "wiggling"])
def test_a_table_of_range_is_the_same_at_every_amplitude(kind: str) -> None:
    drawn = KINDS[kind][0](np.random.default_rng(5), spans(SEEN))
    one = SEEN[0]
    np.testing.assert_array_equal(drawn(one), drawn(Seen(one.radial, one.amplitude[::-1], 100.0)))
