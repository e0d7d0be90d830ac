# SPDX-License-Identifier: Apache-2.0
"""The estimated noise of one capture, from one frame or many, equals the simulated noise."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from benchmarks.tof_frames import captures, edge_rich, noise_of, plane
from tof_preproc.noise import _fit, _least_squares, _moments, law_of_capture, law_of_dwell, robust_variance
from tof_preproc.stack import Stack

if TYPE_CHECKING:
    from tof_core.arrays import Image
    from tof_core.capture import Capture


def stack_of(frames: list[Capture]) -> Stack:
    stack = Stack(frames[0].camera.shape, len(frames), in_time=False)
    for f in frames:
        stack.add(f.depth, f.reason)
    return stack


def ratio(sigma: Image, truth: np.ndarray) -> np.ndarray:
    return np.asarray(sigma / truth)


def test_the_noise_of_a_plane_at_60_degrees_is_estimated_from_one_frame() -> None:
    truth = plane(incidence_deg=60.0, amplitude=300.0)
    frame = captures(truth)[0]
    sigma = law_of_capture(frame.depth, frame.amplitude, 0.0).sigma(frame.depth, frame.amplitude)
    np.testing.assert_allclose(ratio(sigma, noise_of(truth)), 1.0, atol=0.03)


def test_the_photon_law_is_estimated_from_one_frame_full_of_edges() -> None:
    truth = edge_rich()
    frame = captures(truth)[0]
    law = law_of_capture(frame.depth, frame.amplitude, 0.0)
    off = ratio(law.sigma(frame.depth, frame.amplitude), noise_of(truth))
    assert np.quantile(off, [0.05, 0.95]) == pytest.approx([1.0, 1.0], abs=0.17)
    # noise varies eightfold over this frame: the law must follow it, not its mean
    assert np.ptp(np.log(noise_of(truth))) > np.log(6)


@pytest.mark.parametrize("n", [2, 3, 10])
def test_the_photon_law_is_estimated_over_time_despite_edges_and_spikes(n: int) -> None:
    truth = edge_rich()
    frames = captures(truth, n, spikes=0.01, dropouts=0.02)
    law = law_of_dwell(stack_of(frames), frames[0].amplitude, 0.0)
    off = ratio(law.sigma(frames[0].depth, frames[0].amplitude), noise_of(truth))
    assert np.quantile(off, [0.05, 0.95]) == pytest.approx([1.0, 1.0], abs=0.1)


def test_the_law_does_not_depend_on_which_of_equal_amplitudes_comes_first() -> None:
    """NumPy's default sort puts them in an order that depends on the vector instructions of the processor."""
    rng = np.random.default_rng(0)
    amplitude = np.round(rng.uniform(20, 60, 16000))
    noise2 = rng.chisquare(1, 16000) * 1e-4 / amplitude
    other = rng.permutation(16000)
    laws = [_fit(noise2[o], amplitude[o], 1, 0.001, by_range=False) for o in (slice(None), other)]
    assert laws[1].coefficients == pytest.approx(laws[0].coefficients, rel=1e-9)
    assert (laws[1].low, laws[1].high) == (laws[0].low, laws[0].high)


def test_without_amplitude_range_takes_its_place() -> None:
    truth = plane(incidence_deg=50.0)
    law = law_of_capture(captures(truth)[0].depth, None, 0.0)
    assert law.by_range
    np.testing.assert_allclose(ratio(law.sigma(captures(truth)[0].depth, None), noise_of(truth)), 1.0, atol=0.06)


def test_noise_is_never_below_the_quantisation_noise() -> None:
    truth = plane(incidence_deg=0.0)
    frames = captures(truth, 4, noise=0.0, quantum=0.001)
    for law in (law_of_capture(frames[0].depth, None, 0.001), law_of_dwell(stack_of(frames), None, 0.001)):
        np.testing.assert_allclose(law.sigma(frames[0].depth, None), 0.001 / np.sqrt(12), rtol=1e-3)


@pytest.mark.parametrize("depth", [np.full((20, 30), np.nan), np.full((1, 1), 1.0), np.full((2, 2), 1.0)])
def test_frames_without_information_get_a_finite_sigma(depth: np.ndarray) -> None:
    frame = depth.astype(np.float32)
    amplitude = np.full(frame.shape, np.nan, np.float32)
    for brightness in (None, amplitude, np.ones_like(amplitude)):
        assert np.isfinite(law_of_capture(frame, brightness, 0.0).sigma(frame, brightness)).all()


def test_a_tenth_of_outliers_moves_the_variance_by_less_than_a_tenth() -> None:
    rng = np.random.default_rng(0)
    for dof in (1, 4):
        clean = rng.chisquare(dof, 20000) / dof
        soiled = np.where(rng.random(20000) < 0.1, 1e4, clean)
        assert robust_variance(clean, dof, 1e-12) == pytest.approx(1.0, rel=0.03)
        assert robust_variance(soiled, dof, 1e-12) == pytest.approx(1.0, rel=0.1)


@pytest.mark.parametrize("n", [2, 7, 8, 15, 16, 100])
def test_mean_and_variance_over_time_are_numpy_s_to_the_bit(n: int) -> None:
    values = np.sort(np.random.default_rng(n).normal(1.0, 0.01, (17, n)).astype(np.float32), axis=1).astype(float)
    means, variances = _moments(np.ascontiguousarray(values.T))
    np.testing.assert_array_equal(means, values.mean(axis=1))
    np.testing.assert_array_equal(variances, values.var(axis=1, ddof=1))


def test_the_terms_of_a_law_are_those_of_non_negative_least_squares() -> None:
    from scipy.optimize import nnls

    rng = np.random.default_rng(0)
    supports = set()
    for _ in range(200):
        powers = np.sort(np.exp(rng.normal(0, 1, 12)))[:, None] ** -np.arange(3.0)
        variance = (powers @ np.maximum(rng.normal(size=3), 0) + 1e-3) * np.exp(rng.normal(0, 0.1, 12))
        expected = nnls(powers / variance[:, None], np.ones(12))[0]
        supports.add(tuple(expected > 0))
        np.testing.assert_allclose(_least_squares(powers / variance[:, None], np.ones(12)), expected, rtol=1e-7, atol=1e-9)
    assert len(supports) >= 5, "laws of one, two and three terms"


def test_of_equal_laws_the_one_with_fewest_terms_is_taken() -> None:
    assert _least_squares(np.ones((12, 3)), np.ones(12)).tolist() == pytest.approx([1.0, 0.0, 0.0])
