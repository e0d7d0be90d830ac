# SPDX-License-Identifier: Apache-2.0
"""How much of the errors of rays a region of a plane explains."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from tof_gap.solve.hypotheses.sheet_score import Rays, explained

if TYPE_CHECKING:
    from tof_core.arrays import Float

LATE_M = 2e-3
COLUMNS = 10
"""Squares of 8 cm along x, of which the first `LATE` delay light."""
LATE = 3
PAIRS = np.array([(0, 1), (0, 2), (1, 2)])


def score(error: Float, offset_m: float = 1.0) -> Float:
    """(3,) score of the plane z = `offset_m` by rays straight down from z = 2 m to the floor, one a square and fold."""
    x = np.tile(0.08 * (np.arange(COLUMNS) + 0.5), 3)
    point = np.column_stack([x, np.full(len(x), 0.04), np.zeros(len(x))])
    origin = point + np.array([0.0, 0.0, 2.0])
    across = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    folds = np.repeat(np.arange(3), COLUMNS)
    rays = Rays(origin, point, error, np.full(len(x), 2.0), folds)
    return np.asarray(explained(rays, np.array([0.0, 0.0, 1.0]), offset_m, across, PAIRS, 3))


def late(folds: int = 3) -> Float:
    """(30,) errors: `LATE_M` in the first squares of the first `folds` folds, 0 elsewhere."""
    error = np.zeros((3, COLUMNS))
    error[:folds, :LATE] = LATE_M
    return error.ravel()


def test_a_region_explains_its_error_in_the_other_folds() -> None:
    inside, outside = 2.0 * LATE, 2.0 * (COLUMNS - LATE)
    of_one = LATE_M**2 * inside * outside / (inside + outside)  # weighted squares about the mean of a fold
    assert score(late()) == pytest.approx(np.full(3, 2 * of_one))


def test_a_region_that_a_fold_contradicts_counts_against_the_plane() -> None:
    error = late()
    error[2 * COLUMNS :] *= -1.0  # The third fold sees the region nearer.
    assert score(error)[0] == pytest.approx(score(error)[1])
    assert score(error)[0] < score(late())[0]


def test_a_plane_that_no_ray_crosses_explains_nothing() -> None:
    assert score(late(), offset_m=2.5) == pytest.approx(np.zeros(3))


def test_a_plane_within_the_camera_explains_nothing() -> None:
    assert score(late(), offset_m=1.97) == pytest.approx(np.zeros(3))
