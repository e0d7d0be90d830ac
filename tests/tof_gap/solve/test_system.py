# SPDX-License-Identifier: Apache-2.0
"""The reduced linear system against the dense one it stands for."""

from __future__ import annotations

import numpy as np
import pytest

from tof_gap.solve.posterior import subset
from tof_gap.solve.system import OFTEN, Folded, System, arm_steps, fit, map_energy, reduce

RNG = np.random.default_rng(3)
VIEWS, STATIONS, COLUMNS, PIXELS = 6, 2, 3, 200
BASE_SD, ARM_SD, HAND_SD = np.full(6, 0.05), np.full(6, 0.002), np.full(6, 1e-5)
THETA_SD = np.full(COLUMNS, 0.05)
STATION = np.array([0, 0, 0, 1, 1, 1])


def rows() -> list[np.ndarray]:
    """Per view (n, 18 + K + 1): pose columns, effect columns, residual, all in units of sigma."""
    return [RNG.normal(size=(PIXELS, 18 + COLUMNS + 1)) for _ in range(VIEWS)]


def system_of(X: list[np.ndarray]) -> System:
    return System(
        G=np.stack([x.T @ x for x in X]),
        station=STATION,
        n=np.full(VIEWS, float(PIXELS)),
        weight=np.full(VIEWS, float(PIXELS)),
        base_sd=BASE_SD,
        arm_sd=ARM_SD,
        hand_sd=HAND_SD,
        base0=RNG.normal(0, 0.01, (STATIONS, 6)),
        arm0=RNG.normal(0, 1e-3, (VIEWS, 6)),
        hand0=np.zeros(6),
        theta_sd=THETA_SD,
    )


def dense(s: System, X: list[np.ndarray], active: np.ndarray) -> tuple[np.ndarray, float]:
    """All unknowns at once by least squares: b (S), x, theta, then a of every view; and the energy left."""
    k, G = len(active), 6 * STATIONS + 6
    size = G + k + 6 * VIEWS
    A, y = [], []
    for v, x in enumerate(X):
        row = np.zeros((len(x), size))
        at = 6 * int(STATION[v])
        row[:, at : at + 6], row[:, G - 6 : G] = x[:, :6], x[:, 6:12]
        row[:, G : G + k] = x[:, 18 + active]
        row[:, G + k + 6 * v : G + k + 6 * v + 6] = x[:, 12:18]
        A.append(row)
        y.append(x[:, -1])
    sd = np.concatenate([np.tile(BASE_SD, STATIONS), HAND_SD, THETA_SD[active], np.tile(ARM_SD, VIEWS)])
    mean = np.concatenate([-s.base0.ravel(), -s.hand0, np.zeros(k), -s.arm0.ravel()])
    A.append(np.diag(1 / sd))
    y.append(mean / sd)
    whole, target = np.concatenate(A), np.concatenate(y)
    z = np.linalg.lstsq(whole, target, rcond=None)[0]
    return z, float(((whole @ z - target) ** 2).sum())


@pytest.mark.parametrize("active", [[], [1], [0, 1, 2]])
def test_marginal_solution_is_the_dense_one(active: list[int]) -> None:
    X = rows()
    s, columns = system_of(X), np.array(active, np.int64)
    z, energy = dense(s, X, columns)
    solution = fit(s, columns)
    known = 6 * STATIONS + 6 + len(columns)
    np.testing.assert_allclose(solution.z, z[:known], atol=1e-9)
    assert solution.energy == pytest.approx(energy, rel=1e-9)
    np.testing.assert_allclose(arm_steps(s, solution).ravel(), z[known:], atol=1e-9)


def test_a_view_is_judged_by_the_others() -> None:
    X = rows()
    s, active = system_of(X), np.array([0], np.int64)
    folds = np.array([0, 1, 2, 0, 1, 2])
    spoilt = [x.copy() for x in X]
    spoilt[0][:, -1] += 5 * spoilt[0][:, 18]  # an effect in fold 0 alone
    there = system_of(spoilt)
    there = System(there.G, STATION, s.n, s.weight, BASE_SD, ARM_SD, HAND_SD, s.base0, s.arm0, s.hand0, THETA_SD)
    assert Folded(there, folds).held_out(active)[0] > Folded(s, folds).held_out(active)[0] + 1000


@pytest.mark.parametrize("free_hand", [False, True])
def test_the_held_out_score_is_what_the_others_fit_leaves_however_often_it_is_asked(*, free_hand: bool) -> None:
    s, folds, active = system_of(rows()), np.array([0, 1, 2, 0, 1, 2]), np.array([2, 0], np.int64)
    expected = np.empty(VIEWS)
    for v in range(VIEWS):
        z = fit(subset(s, np.flatnonzero(folds != folds[v]).tolist()), active, inflate=2.0, free_hand=free_hand).z
        alone = reduce(subset(s, [v]), active, 2.0)
        expected[v] = alone.energy[0] - 2 * alone.y[0] @ z + z @ alone.H[0] @ z
    folded = Folded(s, folds, 2.0)
    for _ in range(OFTEN + 1):
        np.testing.assert_allclose(folded.held_out(active, free_hand=free_hand), expected, rtol=1e-9)


def test_nothing_is_left_of_a_map_beside_itself() -> None:
    s = system_of([100 * x for x in rows()])
    one, none = np.array([0], np.int64), np.zeros(0, np.int64)
    coefficients = np.array([0.003])
    assert map_energy(s, one, coefficients, one) < 1e-3 * map_energy(s, one, coefficients, none)
