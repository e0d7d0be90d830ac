# SPDX-License-Identifier: Apache-2.0
"""The most that any model could explain: smooth errors of what is known are, white noise is not."""

from __future__ import annotations

import numpy as np
import pytest

from tests.tof_gap.quiet_views import SHAPE, VIEWS, views
from tof_gap.limits.report import ExplainableLimits
from tof_gap.solved import Split
from tof_gap.tell.figures.explainable import _cells, explainable
from tof_gap.tell.figures.shrink import Errors, Shrink

SPLIT = Split((0, 1, 3, 4, 6, 7, 9, 10), (2, 5, 8, 11))
NOISE_M = 0.001
LIMITS = ExplainableLimits()


def gap(shrink: float | None, before_mm: float) -> Shrink:
    """Figures of named effects that reach `shrink`."""
    error = Errors(before_mm, before_mm, 0.0)
    return Shrink(error, error, 1e3 * NOISE_M, shrink, None)


def left_over(wave_m: float) -> list[np.ndarray]:
    """Noise, and a wave over the columns that all views share."""
    rng = np.random.default_rng(3)
    wave = wave_m * np.sqrt(2) * np.sin(2 * np.pi * np.arange(SHAPE[1]) / 56)[None]
    return [rng.normal(0, NOISE_M, SHAPE) + wave for _ in range(VIEWS)]


def test_a_smooth_error_that_no_effect_explains_is_explainable() -> None:
    seen = views(np.random.default_rng(4))
    assert explainable(seen, left_over(0.003), SPLIT, gap(0.0, np.hypot(3, 1)), LIMITS) == pytest.approx(0.98, abs=0.03)


def test_white_noise_is_not_explainable() -> None:
    seen = views(np.random.default_rng(4))
    assert explainable(seen, left_over(0.0), SPLIT, gap(0.5, 2.0), LIMITS) == pytest.approx(0.5, abs=0.01)


def test_without_a_gap_or_views_to_fit_there_is_nothing_to_add() -> None:
    seen = views(np.random.default_rng(4))
    assert explainable(seen, left_over(0.003), SPLIT, gap(None, 2.0), LIMITS) is None
    assert explainable(seen, left_over(0.003), Split((), SPLIT.held_out), gap(0.4, 2.0), LIMITS) == 0.4


def test_cells_hold_the_mean_of_their_pixels() -> None:
    (view, *_) = views(np.random.default_rng(4))
    inputs, mean, pixels = _cells(view, np.full(SHAPE, 0.002), 6)
    assert pixels.sum() == view.smooth.sum()
    assert pixels.max() == 36
    np.testing.assert_allclose(mean, 0.002)
    assert inputs.shape == (len(mean), 9)
    assert inputs[0, 3] == pytest.approx(2.5), "mean row of the first six"
