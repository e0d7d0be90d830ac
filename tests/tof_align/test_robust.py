# SPDX-License-Identifier: Apache-2.0
"""Weights of pixels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.tof_align.made import CONFIG, one_view, section
from tests.tof_align.pixel_rows import view_of
from tof_align import robust
from tof_align.discrepancy import LOCAL
from tof_align.discrepancy import SHARED as SHARED_KINDS
from tof_align.linearise import Linearised, linearise
from tof_align.pixels import take_pixels
from tof_align.robust import first_look, halfway, kernel_width, misfit, tukey, weigh
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
    information = weigh(lin, error, CONFIG.weights, misfit(explained, SHARED)).sum()
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


def test_the_kernel_is_that_of_the_noise_or_of_the_residuals_or_its_least() -> None:
    config = replace(CONFIG.weights, kernel=4.0, kernel_floor_mm=3.0)
    sigma = np.array([1e-3, 5e-3, 1e-4])
    even = np.array([-2e-3, 0.0, 2e-3])  # their robust spread is 1.4826 x 2 mm
    np.testing.assert_allclose(kernel_width(view_of(even, sigma), even, config), [4 * 2.9652e-3, 20e-3, 4 * 2.9652e-3])
    np.testing.assert_allclose(kernel_width(view_of(even, sigma), np.zeros(3), config), [4e-3, 20e-3, 3e-3])


def test_a_weight_is_the_inverse_of_noise_and_of_what_neighbours_share(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of what range explains a twentieth is taken to be wrong, of one view's own bends three tenths, of the surface's nothing."""
    monkeypatch.setattr(robust, "inflation", lambda *_: 2.0)
    config = replace(CONFIG.weights, kernel_floor_mm=1e6)
    error, sigma = np.linspace(-1e-3, 1e-3, 50), np.linspace(1e-3, 2e-3, 50)
    view = view_of(error, sigma, raster=(20, 32))
    explained = np.zeros((50, len(SHARED_KINDS) + len(LOCAL)))
    shares = {"range": 0.05, "amplitude": 0.05, "image": 0.05, "bend": 0.3, "smooth": 0.3}
    rng, misfit2 = np.random.default_rng(3), 0.0
    for k, kind in enumerate((*SHARED_KINDS, *LOCAL)):
        explained[:, k] = rng.normal(0, 1e-3 * (k + 1), 50)
        misfit2 += (shares.get(kind, 0.0) * explained[:, k].std()) ** 2
    beyond = np.linspace(0, 5e-3, 50)
    patch = 20 * 32 / 16
    np.testing.assert_allclose(weigh(view, error, config), 1.0 / (2 * sigma**2), rtol=1e-9)
    np.testing.assert_allclose(
        weigh(view, error, config, misfit(explained, config.shared), beyond),
        1.0 / (2 * sigma**2 + patch * (misfit2 + beyond**2)),
        rtol=1e-9,
    )
    np.testing.assert_allclose(weigh(view, error, config, 0.0, beyond), 1.0 / (2 * sigma**2 + patch * beyond**2), rtol=1e-9)
    assert weigh(view_of([]), np.zeros(0), config).shape == (0,)


def test_halfway_lies_between_two_linearisations_and_leaves_zero() -> None:
    assert halfway(2e-3, None) == 2e-3
    assert halfway(4e-3, 1e-3) == pytest.approx(2e-3)
    assert halfway(1e-3, 0.0) == pytest.approx(1e-5)  # the geometric mean with 0.1 um
    assert halfway(1e-3, halfway(1e-3, halfway(1e-3, 0.0))) > 3e-4


def test_the_first_look_is_one_robust_step_of_least_squares() -> None:
    rng = np.random.default_rng(4)
    J = rng.normal(size=(60, 6))
    residual = J @ rng.normal(0, 1e-3, 6) + rng.normal(0, 1e-3, 60) + 2e-3
    residual[:6] += 0.05
    scale = np.median(np.abs(residual - np.median(residual))) + 1e-4
    root = 1 / (1 + (residual / (3.0 * scale)) ** 2)
    A = root[:, None] * J
    ridge = np.sqrt(1e-6 * (A**2).sum() / 6) * np.eye(6)
    xi = np.linalg.lstsq(np.concatenate([A, ridge]), np.concatenate([root * residual, np.zeros(6)]), rcond=None)[0]
    np.testing.assert_allclose(first_look(view_of(residual, jacobian=J), SHARED), residual - J @ xi, atol=1e-12)


@pytest.mark.parametrize(("count", "looks"), [(12, True), (11, False)])
def test_of_fewer_than_twelve_pixels_no_step_is_taken(count: int, *, looks: bool) -> None:
    view = view_of(np.linspace(-1e-3, 2e-3, count))
    assert (np.abs(first_look(view, SHARED) - view.residual).max() > 1e-6) is np.bool_(looks)


def test_a_view_of_one_plane_has_a_finite_first_look() -> None:
    J = np.zeros((40, 6))
    J[:, 2] = 1.0
    left = first_look(view_of(np.full(40, 3e-3), jacobian=J), SHARED)
    np.testing.assert_allclose(left, 0.0, atol=1e-7)
