# SPDX-License-Identifier: Apache-2.0
"""Any choice of columns beside the poses: against the dense solution that it stands for."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tests.tof_align.column_rows import BASE_SD, COLUMNS, HAND_SD, STATION, STATIONS, THETA_SD, VIEWS, rows, system_of

if TYPE_CHECKING:
    from tof_align.columns import ColumnSystem


def dense(s: ColumnSystem, X: list[np.ndarray], active: np.ndarray) -> tuple[np.ndarray, float]:
    """All unknowns at once by least squares: bases, hand-eye, coefficients, then every view's arm error; and the energy left."""
    k, g = len(active), 6 * STATIONS + 6
    size = g + k + 6 * VIEWS
    A, y = [], []
    for v, x in enumerate(X):
        shared, own = s.chain.links(v)
        row = np.zeros((len(x), size))
        at = 6 * int(STATION[v])
        row[:, at : at + 6], row[:, g - 6 : g] = x[:, :6] @ shared[:, :6], x[:, :6] @ shared[:, 6:]
        row[:, g : g + k] = x[:, 6 + active]
        row[:, g + k + 6 * v : g + k + 6 * v + 6] = x[:, :6] @ own
        A.append(row)
        y.append(x[:, -1])
    _, arm_info, error, arm_error = s.chain.prior()
    sd = np.concatenate([np.tile(BASE_SD, STATIONS), HAND_SD, THETA_SD[active], np.tile(arm_info**-0.5, VIEWS)])
    mean = np.concatenate([-error, np.zeros(k), -arm_error.ravel()])
    A.append(np.diag(1 / sd))
    y.append(mean / sd)
    whole, target = np.concatenate(A), np.concatenate(y)
    z = np.linalg.lstsq(whole, target, rcond=None)[0]
    return z, float(((whole @ z - target) ** 2).sum())


@pytest.mark.parametrize("active", [[], [1], [0, 1, 2]])
def test_the_solution_is_the_dense_one(active: list[int]) -> None:
    X = rows()
    s, columns = system_of(X), np.array(active, np.int64)
    z, energy = dense(s, X, columns)
    solution = s.fit(columns)
    known = 6 * STATIONS + 6 + len(columns)
    np.testing.assert_allclose(solution.answer.x, z[:known], atol=1e-8)
    np.testing.assert_allclose(solution.arm.ravel(), z[known:], atol=1e-8)
    assert solution.energy == pytest.approx(energy, rel=1e-8)
    assert solution.base.shape == (STATIONS, 6)
    assert len(solution.theta) == len(active)


def test_the_chi_square_of_hand_eye_is_that_of_its_whole_deviation() -> None:
    s, active = system_of(rows()), np.zeros(0, np.int64)
    fit = s.fit(active)
    already = s.chain.prior()[2][6 * STATIONS :]
    assert s.mount_chi2(fit) == pytest.approx(float(np.sum(((already + fit.hand_eye) / HAND_SD) ** 2)))
    assert s.mount_chi2(fit) > 0.0


def test_inflated_noise_widens_the_covariance_and_keeps_the_coefficients() -> None:
    X = [x * np.append(np.full(6 + COLUMNS, 100.0), 1.0) for x in rows()]  # pixels, not priors, decide; the residual is noise of one sigma
    s, active = system_of(X), np.arange(COLUMNS)
    once, often = s.fit(active), s.fit(active, inflate=4.0)
    np.testing.assert_allclose(np.diag(often.theta_cov) / np.diag(once.theta_cov), 4.0, rtol=0.05)
    np.testing.assert_allclose(often.theta, once.theta, atol=3 * float(np.sqrt(np.diag(often.theta_cov).max())))


def test_nothing_is_left_of_a_map_beside_itself() -> None:
    s = system_of([100 * x for x in rows()])
    one, none, coefficients = np.array([0], np.int64), np.zeros(0, np.int64), np.array([0.003])
    assert s.left_of(one, coefficients, one) < 1e-3 * s.left_of(one, coefficients, none)


def test_a_map_that_no_pose_imitates_keeps_its_energy() -> None:
    X = rows()
    s, one, coefficients = system_of(X), np.array([1], np.int64), np.array([0.01])
    energy = sum(float((x[:, 7] ** 2).sum()) for x in X) * coefficients[0] ** 2
    assert s.left_of(one, coefficients, np.zeros(0, np.int64)) == pytest.approx(energy, rel=0.1)


def test_fitted_to_some_views_the_bases_stay_where_the_whole_solution_has_them() -> None:
    s, active = system_of(rows()), np.arange(COLUMNS)
    whole = s.fit(active)
    part = s.fit_to([0, 1, 4], whole, inflate=1.0, free_hand=False)
    np.testing.assert_allclose(part.base, whole.base, atol=1e-6)
    assert np.diag(part.theta_cov).min() > np.diag(whole.theta_cov).min()


def test_bases_held_to_the_chain_are_not_drawn_to_the_robots_word() -> None:
    X = [1e-6 * x for x in rows()]
    free, held = system_of(X), system_of(X, at_chain=True)
    none = np.zeros(0, np.int64)
    assert float(np.abs(held.fit(none).base).max()) < 1e-6
    assert float(np.abs(free.fit(none).base).max()) > 1e-3


def test_the_covariance_of_a_camera_holds_all_its_links() -> None:
    X = rows()
    s, active = system_of(X), np.array([0, 2], np.int64)
    covs = s.camera_covs(s.fit(active))
    info, arm_info, _, _ = s.chain.prior()
    g, size = len(info), len(info) + len(active) + 6 * VIEWS
    H = np.diag(np.concatenate([s.normal.info[:g], THETA_SD[active] ** -2, np.tile(arm_info, VIEWS)]))
    L = []
    for v, x in enumerate(X):
        shared, own = s.chain.links(v)
        link = np.zeros((6, size))
        link[:, s.chain.where(v)], link[:, g + len(active) + 6 * v :][:, :6] = shared, own
        row = x[:, :6] @ link
        row[:, g : g + len(active)] += x[:, 6 + active]
        H += row.T @ row
        L.append(link)
    C = np.linalg.inv(H)
    np.testing.assert_allclose(covs, [link @ C @ link.T for link in L], rtol=1e-5, atol=1e-12)


def test_some_views_alone_are_the_system_of_those_views() -> None:
    s = system_of(rows())
    part = s.subset([1, 5])
    assert part.pixels.tolist() == s.pixels[[1, 5]].tolist()
    np.testing.assert_array_equal(part.normal.gram, s.normal.gram[[1, 5]])
    assert replace(part.chain, priors=s.chain.priors).station.tolist() == STATION[[1, 5]].tolist()


def test_an_error_that_pixels_share_with_their_noise_counts_for_fewer_of_them() -> None:
    """Ten drawn pixels have the noise of one: what thirty of them share is shared by three independent ones, and never by fewer than one."""
    system = system_of([2.0 * x for x in rows()])
    active = np.arange(COLUMNS)
    excess = system.inflation(active, 1.0) - 1.0
    assert system.inflation(active, 30.0) - 1.0 == pytest.approx(30.0 * excess)
    for per, share in ((10.0, 3.0), (100.0, 1.0)):
        assert replace(system, drawn=per * system.pixels).inflation(active, 30.0) - 1.0 == pytest.approx(share * excess)
