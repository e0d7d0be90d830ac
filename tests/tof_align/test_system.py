# SPDX-License-Identifier: Apache-2.0
"""Refitting without rendering: the algebra against brute force."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from tests.tof_align.made import CONFIG, section, session, wiggling
from tof_align.session import SessionSolution, solve_session

if TYPE_CHECKING:
    from tof_align.chain import Chain
    from tof_align.system import SessionSystem


@pytest.fixture(scope="module")
def solution() -> SessionSolution:
    views, _ = session(section(), views=4, effect=wiggling)
    return solve_session(views, section(), CONFIG)


def columns(system: SessionSystem[Chain]) -> list[np.ndarray]:
    reach = [v.depth * v.ray_length for v in system.views]
    return [np.stack([np.sin(2 * np.pi * r / 0.375), np.cos(2 * np.pi * r / 0.375), r], axis=1) for r in reach]


def brute(system: SessionSystem[Chain], C: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Rows of every weighted pixel and of every prior, over [base, hand-eye, arms, theta]."""
    info, own_info, error, own_error = system.rig.prior()
    g, V, k = len(info), len(system.views), C[0].shape[1]
    rows, right = [], []
    for v, view in enumerate(system.views):
        shared, own = system.rig.links(v)
        A = np.zeros((len(view.residual), g + 6 * V + k))
        A[:, system.rig.where(v)] = view.jacobian @ shared
        A[:, g + 6 * v : g + 6 * v + 6] = view.jacobian @ own
        A[:, g + 6 * V :] = C[v]
        root = np.sqrt(system.weights[v])
        rows.append(A * root[:, None])
        right.append(root * view.residual)
    prior = np.sqrt(np.concatenate([info, np.tile(own_info, V), np.zeros(k)]))
    rows.append(np.diag(prior)[: g + 6 * V])
    right.append(-(prior * np.concatenate([error, own_error.ravel(), np.zeros(k)]))[: g + 6 * V])
    return np.concatenate(rows), np.concatenate(right)


def test_the_solution_is_the_dense_one_with_its_covariance_and_energy(solution: SessionSolution) -> None:
    system = solution.system
    C = columns(system)
    A, y = brute(system, C)
    full, *_ = np.linalg.lstsq(A, y, rcond=None)
    answer = system.solve(C, discrepancy=False)
    np.testing.assert_allclose(answer.x[-3:], full[-3:], rtol=1e-6)
    np.testing.assert_allclose(answer.cov[-3:, -3:], np.linalg.inv(A.T @ A)[-3:, -3:], rtol=1e-6)
    assert answer.energy == pytest.approx(float(((y - A @ full) ** 2).sum()), rel=1e-6)


def test_camera_steps_are_those_of_the_dense_solution(solution: SessionSolution) -> None:
    system = solution.system
    C = columns(system)
    A, y = brute(system, C)
    left = (y - A @ np.linalg.lstsq(A, y, rcond=None)[0])[: sum(len(v.residual) for v in system.views)]
    answer = system.solve(C, discrepancy=False)
    steps, theta = system.camera_steps(answer), answer.x[-3:]
    ours = [
        np.sqrt(w) * (v.residual - c @ theta - v.jacobian @ d) for w, v, c, d in zip(system.weights, system.views, C, steps, strict=True)
    ]
    np.testing.assert_allclose(np.concatenate(ours), left, atol=1e-6)


def test_reference_the_discrepancy_a_wiggle_is_no_longer_evidence(solution: SessionSolution) -> None:
    system = solution.system
    wiggle = [c[:, :2] for c in columns(system)]

    def gain(*, discrepancy: bool) -> float:
        return system.solve(discrepancy=discrepancy).energy - system.solve(wiggle, discrepancy=discrepancy).energy

    assert gain(discrepancy=False) > 20 * gain(discrepancy=True)
