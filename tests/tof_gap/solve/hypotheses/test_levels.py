# SPDX-License-Identifier: Apache-2.0
"""Two levels of an error."""

from __future__ import annotations

import numpy as np
import pytest

from tof_gap.solve.hypotheses.levels import levels


def test_levels_are_the_weighted_means_on_both_sides_of_the_best_split() -> None:
    found = levels(np.array([3.0, 0.0, 1.0, 4.0]), np.array([1.0, 3.0, 1.0, 1.0]))
    assert found is not None
    assert found.low == pytest.approx((3 * 0.0 + 1.0) / 4)
    assert found.high == pytest.approx((3.0 + 4.0) / 2)
    assert found.middle == pytest.approx(1.875)


def test_the_higher_level_may_be_that_of_few_pixels_and_not_of_most() -> None:
    means = np.array([0.0, 1.0])
    assert levels(means, np.array([97.0, 3.0])) is not None
    assert levels(means, np.array([99.0, 1.0])) is None  # 1 %, and 2 % are asked for
    assert levels(means, np.array([35.0, 65.0])) is None  # more than 60 %: an offset, whose complement is the region


def test_no_levels_of_one_mean_or_none() -> None:
    assert levels(np.array([1.0]), np.array([1.0])) is None
    assert levels(np.zeros(0), np.zeros(0)) is None
