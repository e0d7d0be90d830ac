# SPDX-License-Identifier: Apache-2.0
"""Pooled figures are those of all images at once."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tof_core.metrics import depth_error
from tof_eval.pooled import PooledError
from tof_eval.tables import depth_table


def test_pooling_images_gives_the_figures_of_their_stack() -> None:
    rng = np.random.default_rng(0)
    true = rng.uniform(0.5, 2.0, (5, 20, 30)).astype(np.float32)
    measured = (true + rng.normal(0.002, 0.01, true.shape)).astype(np.float32)
    measured[rng.random(true.shape) < 0.2] = np.nan
    true[rng.random(true.shape) < 0.1] = np.nan
    where = rng.random(true.shape) < 0.7
    pooled = PooledError()
    for image in range(5):
        pooled.add(measured[image], true[image], where[image])
    assert pooled.error.to_dict() == pytest.approx(depth_error(measured, true, where).to_dict(), rel=1e-9)


def test_an_image_without_pixels_changes_nothing_but_completeness() -> None:
    pooled = PooledError()
    pooled.add(np.full((2, 2), 1.01, np.float32), np.ones((2, 2), np.float32))
    pooled.add(np.full((2, 2), np.nan, np.float32), np.ones((2, 2), np.float32))
    assert pooled.error.mae == pytest.approx(0.01, rel=1e-5)
    assert pooled.error.completeness == 0.5


def test_nothing_compared_is_nan() -> None:
    assert math.isnan(PooledError().error.mae)


def test_the_table_is_in_millimetres() -> None:
    pooled = PooledError()
    pooled.add(np.full((2, 2), 1.5, np.float32), np.ones((2, 2), np.float32))
    assert depth_table([("raw", pooled.error)]).splitlines()[1].split() == ["raw", "500.00", "500.00", "+500.00", "100.0", "50.00", "4"]
