# SPDX-License-Identifier: Apache-2.0
"""Weights of pixels."""

from __future__ import annotations

import numpy as np
import pytest

from tests.tof_align.made import CONFIG, one_view, section
from tof_align.discrepancy import LOCAL
from tof_align.discrepancy import SHARED as SHARED_KINDS
from tof_align.linearise import Linearised, linearise
from tof_align.pixels import take_pixels
from tof_align.robust import first_look, tukey, weigh
from tof_core import se3
from tof_core.stats import robust_std

SHARED = CONFIG.weights.shared


@pytest.fixture(scope="module")
def lin() -> Linearised:
    view, truth = one_view(section(), np.zeros(6))
    return linearise(take_pixels(view, CONFIG.weights), truth.T_cell_camera, section(), CONFIG.weights)


def test_tukey_is_one_at_zero_and_nothing_outside() -> None:
    np.testing.assert_allclose(tukey(np.array([0.0, 0.5, 1.0, -2.0]), 1.0), [1.0, 0.5625, 0.0, 0.0])


def test_a_part_that_is_missing_does_not_count(lin: Linearised) -> None:
    error = 1e-3 * np.random.default_rng(0).normal(size=len(lin.residual))
    gone = lin.point[:, 1] > 0.15
    error[gone] += 0.05
    weight = weigh(lin, error, CONFIG.weights)
    assert weight[gone].max() == 0.0
    assert np.median(weight[~gone]) > 0


def test_independent_pixels_weigh_as_their_noise_says(lin: Linearised) -> None:
    error = lin.sigma * np.random.default_rng(0).normal(size=len(lin.residual))
    ratio = weigh(lin, error, CONFIG.weights) * lin.sigma**2
    assert 0.7 < np.median(ratio) < 1.4


def test_a_share_of_what_is_unmodelled_limits_what_a_sixteenth_of_the_image_can_say(lin: Linearised) -> None:
    error = lin.sigma * np.random.default_rng(0).normal(size=len(lin.residual))
    explained = np.zeros((len(error), len(SHARED_KINDS) + len(LOCAL)))
    explained[:, 0] = 4e-3 * np.sign(np.arange(len(error)) % 2 - 0.5)
    information = weigh(lin, error, CONFIG.weights, explained).sum()
    patches = len(error) / (lin.raster[0] * lin.raster[1] / 16)
    assert information < patches / (0.05 * 4e-3) ** 2
    assert information == pytest.approx(patches / (0.05 * 4e-3) ** 2, rel=0.35)


def test_the_first_look_takes_a_free_pose_out(lin: Linearised) -> None:
    moved = linearise_at_an_error(np.array([0.002, -0.001, 0.004, 0.002, 0.003, -0.002]))
    assert robust_std(first_look(moved, SHARED)) < 0.5 * robust_std(moved.residual)
    assert robust_std(first_look(moved, SHARED)) < 1.3 * robust_std(first_look(lin, SHARED))


def linearise_at_an_error(error: np.ndarray) -> Linearised:
    view, truth = one_view(section(), np.zeros(6))
    return linearise(take_pixels(view, CONFIG.weights), truth.T_cell_camera @ se3.exp(error), section(), CONFIG.weights)
