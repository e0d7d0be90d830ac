# SPDX-License-Identifier: Apache-2.0
"""Samples of a pixel are counted per triangle, and what lies behind a full pixel is not drawn."""

from __future__ import annotations

import numpy as np
import pytest

from tof_scene.resolve import _all_nearer
from tof_scene.surfaces import tally


def test_samples_are_counted_and_summed_per_triangle_nearest_first() -> None:
    inverse = np.array([0.5, 0.5, 1.0, 0.0, 0.25], np.float32)
    owner = np.array([2, 2, 0, -1, 2], np.int32)
    count, sums, depths, seen = np.full(3, 9, np.int32), np.full((3, 3), 9, np.float32), np.full((3, 3), 9.0), np.zeros(3, np.int32)
    found, void = tally(inverse, owner, np.array([2, 1, 0], np.int32), count, sums, depths, seen)
    assert (found, void) == (2, 1)
    assert seen[:2].tolist() == [0, 2]
    assert count.tolist() == [1, 0, 3]
    assert depths[[0, 2]].tolist() == [[1.0, 1.0, 1.0], [8.0, 2.0, 4.0]]
    assert inverse[[0, 2, 4]].tolist() == [2.0, 1.0, 4.0]


@pytest.mark.parametrize(("change", "nearer"), [({}, True), ({40: 0.0}, False), ({40: 0.5}, False), ({40: np.float32(0.5000001)}, True)])
def test_a_triangle_is_hidden_where_every_sample_is_filled_by_something_nearer(change: dict[int, float], *, nearer: bool) -> None:
    inverse = np.full(89, 1.0, np.float32)
    for at, value in change.items():
        inverse[at] = value
    assert _all_nearer(inverse, np.float32(2.0)) == nearer
