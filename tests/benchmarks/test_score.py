# SPDX-License-Identifier: Apache-2.0
"""What a score of the gap check measures."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.gap_check.score import auroc


def test_the_place_of_an_effect_is_where_it_touches_and_not_where_rounding_differs() -> None:
    """100 of 10,000 pixels are off by centimetres, the others by nanometres; all 100 are ranked above the rest, or below."""
    rng = np.random.default_rng(0)
    true = 1e-9 * rng.random(10_000)
    true[:100] = 0.02
    named = np.zeros(10_000)
    named[:100] = 0.01
    assert auroc(named, true) == pytest.approx(1.0)
    assert auroc(0.01 - named, true) == pytest.approx(0.0)
    assert auroc(np.ones(10_000), true) == pytest.approx(0.5)


def test_of_an_effect_that_touches_all_pixels_the_worst_tenth_counts() -> None:
    true = np.random.default_rng(0).random(10_000)
    assert auroc(true, true) == pytest.approx(1.0)
    assert auroc((true > np.quantile(true, 0.9)).astype(float), true) == pytest.approx(1.0)
    assert auroc((true > np.quantile(true, 0.8)).astype(float), true) == pytest.approx(1.0 - 0.5 / 9, abs=1e-3)
