# SPDX-License-Identifier: Apache-2.0
"""The maps of a view: means of neighbouring pixels with their own noise, nothing where nothing is compared."""

from __future__ import annotations

import numpy as np
import pytest

from tof_gap.tell.report.pictures import SMOOTH_PX, _smooth


def test_the_mean_of_a_square_has_the_noise_of_its_pixels() -> None:
    rng = np.random.default_rng(0)
    gap = rng.normal(0.004, 0.002, (200, 200))
    mean, noise = _smooth(gap, np.full(gap.shape, 0.002**2))
    inner = slice(SMOOTH_PX, -SMOOTH_PX)
    assert noise[inner, inner] == pytest.approx(2.0 / SMOOTH_PX)
    assert np.std(mean[inner, inner]) == pytest.approx(2.0 / SMOOTH_PX, rel=0.1)
    assert np.mean(mean) == pytest.approx(4.0, abs=0.05)


def test_fewer_known_neighbours_make_a_mean_noisier_and_unknown_pixels_have_none() -> None:
    gap = np.full((21, 21), 0.003)
    gap[:, 11:] = np.nan
    mean, noise = _smooth(gap, np.full(gap.shape, 0.001**2))
    assert np.isnan(mean[10, 11])
    assert mean[10, 10] == pytest.approx(3.0)
    assert noise[10, 10] == pytest.approx(1.0 / np.sqrt(15), rel=1e-6), "three of its five columns are known"
