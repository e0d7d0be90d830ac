# SPDX-License-Identifier: Apache-2.0
"""Held-out scores against fits to the other folds' views, one by one."""

from __future__ import annotations

import numpy as np
import pytest

from tests.tof_align.column_rows import STATION, VIEWS, rows, system_of
from tof_align.folds import Folds, deal
from tof_align.mixed import by_view

FOLDS = np.array([0, 1, 2, 0, 1, 2])


def test_a_view_is_judged_by_the_views_of_other_folds() -> None:
    X, active = rows(), np.array([0], np.int64)
    system = system_of(X)
    X[0][:, -1] += 5 * X[0][:, 6]  # an effect in fold 0 alone
    gram = system.normal.gram.copy()
    before = Folds(system, FOLDS).held_out(active)[0]
    gram[0] = system_of(X).normal.gram[0]
    system.normal.gram[:] = gram
    assert Folds(system, FOLDS).held_out(active)[0] > before + 1000


@pytest.mark.parametrize("free_hand", [False, True])
def test_the_held_out_score_is_what_the_others_fit_leaves(*, free_hand: bool) -> None:
    s, active = system_of(rows()), np.array([2, 0], np.int64)
    expected = np.empty(VIEWS)
    for v in range(VIEWS):
        others = s.subset(np.flatnonzero(FOLDS[v] != FOLDS).tolist())
        x = others.fit(active, inflate=2.0, free_hand=free_hand).answer.x
        alone = s.subset([v])
        views = by_view(alone.chosen(active, inflate=2.0), {})
        H, b = views.placed(alone.placed(len(active)), len(x))
        expected[v] = views.energy[0] - 2 * b[0] @ x + x @ H[0] @ x
    np.testing.assert_allclose(Folds(s, FOLDS, 2.0).held_out(active, free_hand=free_hand), expected, rtol=1e-8)


@pytest.mark.parametrize("free_hand", [False, True])
@pytest.mark.parametrize("rest", [[], [1]])
def test_groups_beside_the_same_columns_score_as_each_by_itself(rest: list[int], *, free_hand: bool) -> None:
    folds, shared = Folds(system_of(rows()), FOLDS, 2.0), np.array(rest, np.int64)
    groups = [np.array(g, np.int64) for g in ([0], [2], [0, 2])]
    expected = [folds.held_out(np.concatenate([shared, g]), free_hand=free_hand) for g in groups]
    np.testing.assert_allclose(folds.held_out_beside(shared, groups, free_hand=free_hand), expected, rtol=1e-8)


@pytest.mark.parametrize("folds", [2, 3, 6])
def test_every_fold_leaves_every_station_some_views(folds: int) -> None:
    fold = deal([*STATION.tolist(), 1, 1], folds)
    for f in set(fold.tolist()):
        assert set(np.array([*STATION, 1, 1])[fold != f].tolist()) == {0, 1}
