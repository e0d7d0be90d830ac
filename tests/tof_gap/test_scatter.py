# SPDX-License-Identifier: Apache-2.0
"""Scatter: the photon law is found again, steps are seen, smooth bias is no scatter."""

from __future__ import annotations

import numpy as np
import pytest

from tof_gap.evidence import robust_std, scatter
from tof_gap.scatter import Bins, depth_step, fit_law

RNG = np.random.default_rng(2)


def test_scatter_does_not_see_what_is_smooth() -> None:
    v, u = np.mgrid[:150, :200] / 50.0
    residual = 0.02 * np.sin(v) * np.cos(u) + RNG.normal(0, 0.002, v.shape)
    sigma = scatter(residual, np.ones(v.shape, bool), np.full(v.shape, 1000.0) * np.exp(0.1 * v))
    assert np.median(sigma) == pytest.approx(0.002, rel=0.03)


def test_law_of_shot_and_ambient_is_found_without_a_floor() -> None:
    amplitude = np.geomspace(100, 10000, 40)
    ratio = np.median(amplitude) / amplitude
    variance = 0.001**2 * ratio + 0.0005**2 * ratio**2
    law = fit_law(Bins(np.zeros(40), amplitude, variance, np.full(40, 2000.0)), 0.0).law
    assert law.shot_m == pytest.approx(0.001, rel=0.02)
    assert law.ambient_m == pytest.approx(0.0005, rel=0.02)
    assert law.floor_m < 1e-4


def test_constant_scatter_shows_as_a_floor() -> None:
    amplitude = np.geomspace(100, 10000, 40)
    variance = 0.003**2 + 0.001**2 * np.median(amplitude) / amplitude
    assert fit_law(Bins(np.zeros(40), amplitude, variance, np.full(40, 2000.0)), 0.001).law.floor_m == pytest.approx(0.003, rel=0.05)


@pytest.mark.parametrize("step", [0.001, 0.005, 0.0125])
def test_step_of_the_code_is_seen(step: float) -> None:
    depth = np.round(RNG.uniform(0.5, 0.9, (100, 100)) / step) * step
    assert depth_step(depth) == pytest.approx(step, rel=1e-3)


def test_continuous_depth_has_no_step() -> None:
    assert depth_step(RNG.uniform(0.5, 1.0, (100, 100))) == 0.0


def test_robust_std_ignores_outliers() -> None:
    values = np.concatenate([RNG.normal(0, 1, 10000), np.full(50, 100.0)])
    assert robust_std(values) == pytest.approx(1.0, rel=0.03)
