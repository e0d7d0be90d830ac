# SPDX-License-Identifier: Apache-2.0
"""The linear mixed model against one dense solve of everything."""

from __future__ import annotations

import numpy as np
import pytest

from tof_align.mixed import DOUBT, Normal, estimate, solve


def model(
    rng: np.random.Generator, views: int = 5, rows: int = 60, noise: float = 0.01, size: float = 1.0
) -> tuple[Normal, np.ndarray, np.ndarray]:
    """Views with 3 shared fixed unknowns (prior 1), 4 shared of unknown size, 2 own with a prior, 3 own of unknown size."""
    x = np.concatenate([rng.normal(size=3), size * rng.normal(size=4)])
    blocks, dense, right = [], [], []
    for v in range(views):
        D = rng.normal(size=(rows, 12))
        own = np.concatenate([rng.normal(size=2), 0.5 * rng.normal(size=3)])
        y = D @ np.concatenate([x, own]) + noise * rng.normal(size=rows)
        full = np.concatenate([D, y[:, None]], axis=1) / noise
        blocks.append(full.T @ full)
        row = np.zeros((rows, 7 + 5 * views))
        row[:, :7], row[:, 7 + 5 * v : 12 + 5 * v] = D[:, :7], D[:, 7:]
        dense.append(row / noise)
        right.append(y / noise)
    normal = Normal(
        gram=np.array(blocks), where=np.tile(np.arange(7), (views, 1)), info=np.array([1.0, 1, 1, 0, 0, 0, 0]),
        own_info=np.array([1.0, 1, 0, 0, 0]), error=np.zeros(7), own_error=np.zeros((views, 5)),
        kinds={"shared": np.arange(3, 7)}, own_kinds={"own": np.arange(2, 5)},
    )  # fmt: skip
    return normal, np.concatenate(dense), np.concatenate(right)


def test_eliminating_view_by_view_is_the_dense_solution_with_its_covariance() -> None:
    normal, A, y = model(np.random.default_rng(0), noise=0.5)
    answer = solve(normal, {"shared": 0.7, "own": 0.3})
    prior = np.concatenate([np.ones(3), np.full(4, 0.7**-2), np.tile([1, 1, *[0.3**-2] * 3], 5)])
    H = A.T @ A + np.diag(prior)
    x = np.linalg.solve(H, A.T @ y)
    np.testing.assert_allclose(answer.x, x[:7], atol=1e-9)
    np.testing.assert_allclose(answer.own.ravel(), x[7:], atol=1e-9)
    cov = np.linalg.inv(H)
    at = np.concatenate([np.arange(7), 7 + 5 * 2 + np.arange(5)])
    np.testing.assert_allclose(answer.joint_cov(2), cov[np.ix_(at, at)], atol=1e-9)
    assert answer.energy == pytest.approx(float(((y - A @ x) ** 2).sum() + x @ (prior * x)), rel=1e-9)


def test_the_state_so_far_pulls_back_to_the_priors_mean() -> None:
    normal, _, _ = model(np.random.default_rng(1))
    strong = Normal(normal.gram * 1e-12, normal.where, np.ones(7), np.ones(5), np.arange(7.0), np.tile(np.arange(5.0), (5, 1)))
    answer = solve(strong, {})
    np.testing.assert_allclose(answer.x, -np.arange(7.0), rtol=1e-4, atol=1e-6)
    np.testing.assert_allclose(answer.own, np.tile(-np.arange(5.0), (5, 1)), rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize("size", [0.05, 1.0, 3.0])
def test_sizes_are_found_from_the_data(size: float) -> None:
    normal, _, _ = model(np.random.default_rng(2), views=30, size=size)
    answer = estimate(normal, {"shared": 0.3, "own": 0.3}, rounds=50, low=dict.fromkeys(("shared", "own"), 1e-4), high=100.0)
    rms = float(np.sqrt((answer.x[3:] ** 2).mean()))
    assert answer.sizes["shared"] == pytest.approx(rms * np.sqrt(4 / (4 + DOUBT)), rel=0.05)
    assert answer.sizes["own"] == pytest.approx(0.5, rel=0.15)


def test_a_size_nobody_needs_shrinks_to_the_noise() -> None:
    normal, _, _ = model(np.random.default_rng(3), views=30, size=0.0)
    answer = estimate(normal, {"shared": 1.0, "own": 1.0}, rounds=50, low=dict.fromkeys(("shared", "own"), 1e-4), high=100.0)
    assert answer.sizes["shared"] < 2e-3
