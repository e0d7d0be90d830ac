# SPDX-License-Identifier: Apache-2.0
"""The quantisation step is found where there is one, and the stated error of a mean agrees with simulation."""

from __future__ import annotations

import numpy as np
import pytest

from tof_preproc.quantum import mean_error2, quantum_of


@pytest.mark.parametrize("step", [0.001, 0.00025, 0.004])
def test_the_quantisation_step_is_found_in_float32(step: float) -> None:
    rng = np.random.default_rng(0)
    depth = (np.round(rng.uniform(0.5, 4.0, (60, 80)) / step) * step).astype(np.float32)
    depth[::7] = np.nan
    assert quantum_of(depth) == pytest.approx(step, rel=1e-4)


@pytest.mark.parametrize(
    "depth",
    [
        np.random.default_rng(0).uniform(0.5, 4.0, (60, 80)),
        np.full((4, 4), np.nan),
        np.ones((4, 4)),
        np.zeros((0, 0)),
    ],
)
def test_values_without_a_common_step_have_none(depth: np.ndarray) -> None:
    assert quantum_of(depth.astype(np.float32)) == 0.0


@pytest.mark.parametrize("noise", [0.0, 0.1, 0.2, 0.3, 0.5, 1.0])
@pytest.mark.parametrize("captures", [1, 4, 30])
def test_the_error_of_a_mean_of_codes_is_what_simulation_gives(noise: float, captures: int) -> None:
    rng = np.random.default_rng(1)
    truth = rng.uniform(0, 1, 20000)
    codes = np.round(truth[:, None] + noise * rng.standard_normal((20000, captures)))
    simulated = np.mean((codes.mean(axis=1) - truth) ** 2)
    computed = mean_error2(noise**2 + 1 / 12, 1 / captures, 1.0, False)
    assert computed == pytest.approx(simulated, rel=0.08)


def test_quantisation_without_noise_does_not_average_out() -> None:
    assert mean_error2(1 / 12, 1e-9, 1.0, False) == pytest.approx(1 / 12)


@pytest.mark.parametrize("ratio", [0.002, 0.05, 0.3, 1.0, 1.4, 1.6, 4.0])
def test_terms_left_out_change_no_bit(ratio: float) -> None:
    bias2 = 0.0
    for k in range(1, 12):
        bias2 += np.exp(-4 * np.pi**2 * k * k * ratio) / (k * k)
    variance = ratio + 1 / 12
    bias2 *= 1 / (2 * np.pi**2)
    whole = max(variance - bias2, 0.0) / 256 + bias2
    assert mean_error2(variance, 1 / 256, 1.0, False) == pytest.approx(whole, rel=1e-15)
