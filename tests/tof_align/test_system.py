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


def test_eliminating_the_poses_gives_the_same_coefficients_covariance_and_energy_as_solving_for_all(solution: SessionSolution) -> None:
    system = solution.system
    C = columns(system)
    A, y = brute(system, C)
    full, *_ = np.linalg.lstsq(A, y, rcond=None)
    cov = np.linalg.inv(A.T @ A)[-3:, -3:]
    free = system.eliminate(C)
    theta, theta_cov, left = free.fit([0, 1, 2])
    np.testing.assert_allclose(theta, full[-3:], rtol=1e-6)
    np.testing.assert_allclose(theta_cov, cov, rtol=1e-6)
    assert left == pytest.approx(float(((y - A @ full) ** 2).sum()), rel=1e-6)
    poses_alone = np.linalg.lstsq(A[:, :-3], y, rcond=None)[0]
    assert free.energy == pytest.approx(float(((y - A[:, :-3] @ poses_alone) ** 2).sum()), rel=1e-6)


def test_a_subset_of_columns_needs_no_new_elimination(solution: SessionSolution) -> None:
    system = solution.system
    C = columns(system)
    some, cov, left = system.eliminate(C).fit([0, 1])
    direct, direct_cov, direct_left = system.eliminate([c[:, :2] for c in C]).fit([0, 1])
    np.testing.assert_allclose(some, direct, rtol=1e-6)
    np.testing.assert_allclose(cov, direct_cov, rtol=1e-6)
    assert left == pytest.approx(direct_left, rel=1e-9)
    assert system.eliminate(C).fit([])[2] == system.eliminate(C).energy


def test_residuals_are_those_of_the_joint_solution(solution: SessionSolution) -> None:
    system = solution.system
    C = columns(system)
    theta, _, _ = system.eliminate(C).fit([0, 1, 2])
    A, y = brute(system, C)
    left = (y - A @ np.linalg.lstsq(A, y, rcond=None)[0])[: sum(len(v.residual) for v in system.views)]
    ours = np.concatenate([np.sqrt(w) * r for w, r in zip(system.weights, system.residuals(C, theta), strict=True)])
    np.testing.assert_allclose(ours, left, atol=1e-6)


def test_some_views_alone(solution: SessionSolution) -> None:
    part = solution.system.subset([0, 3])
    assert [v.T_cell_camera[0, 3] for v in part.views] == [solution.system.views[i].T_cell_camera[0, 3] for i in (0, 3)]
    theta, cov, _ = part.eliminate([columns(part)[0], columns(part)[1]]).fit([0, 1])
    wide = solution.system.eliminate(columns(solution.system)).fit([0, 1])[1]
    assert np.isfinite(theta).all()
    assert np.diag(cov).min() > np.diag(wide).min()


def test_with_the_discrepancy_projected_out_a_wiggle_is_no_longer_evidence(solution: SessionSolution) -> None:
    system = solution.system
    C = columns(system)
    plain, careful = system.eliminate(C), system.eliminate(C, discrepancy=True)
    gain = plain.energy - plain.fit([0, 1])[2]
    careful_gain = careful.energy - careful.fit([0, 1])[2]
    assert gain > 20 * careful_gain
