# SPDX-License-Identifier: Apache-2.0
"""Where a camera that averages takes in all neighbours, by the noise that they share."""

from __future__ import annotations

import numpy as np
import pytest

from tests.tof_gap.quiet_views import SHAPE, VIEWS, views
from tof_gap.limits.noise import NoiseLimits
from tof_gap.seen.evidence.correlation import INDEPENDENT, NoiseCorrelation
from tof_gap.seen.noise.photons import binned
from tof_gap.seen.noise.whole_average import wholly_averaged
from tof_sensor.session import NoiseBins

AVERAGING = NoiseCorrelation(lever=3.0, line=3.0, area=9.0, growth=1.5)


def bins(growth: np.ndarray, view: np.ndarray | None = None) -> NoiseBins:
    """One bin for each growth of the variance with the distance of the samples, of one view or of several."""
    one = np.ones(len(growth))
    return NoiseBins(0.0 * one if view is None else view, growth, one, one, one, 2000.0 * one, growth=growth)


def test_an_average_is_whole_where_neighbours_share_as_much_noise_as_in_the_whole_session() -> None:
    """1.0: independent pixels, as beside lost ones; 1.2: fewer neighbours; 2.5: a crease, whose differences grow with the distance."""
    kept = wholly_averaged(bins(np.array([1.0, 1.2, 1.35, 1.5, 1.8, 2.5])), AVERAGING)
    np.testing.assert_array_equal(kept.growth, [1.35, 1.5, 1.8])


def test_a_view_of_fewer_than_three_such_bins_is_not_judged() -> None:
    kept = wholly_averaged(bins(np.full(5, 1.5), np.array([0.0, 0.0, 1.0, 1.0, 1.0])), AVERAGING)
    np.testing.assert_array_equal(kept.view, [1, 1, 1])


def test_a_camera_that_does_not_average_is_judged_in_all_bins() -> None:
    assert len(wholly_averaged(bins(np.array([0.9, 1.0, 3.0])), INDEPENDENT).view) == 3


def test_independent_noise_does_not_grow_with_the_distance_of_the_samples() -> None:
    seen = binned(views(np.random.default_rng(1)), 4, NoiseLimits())
    assert seen.growth is not None
    assert SHAPE[0] * SHAPE[1] > 2000
    assert len(seen.growth) == 4 * VIEWS
    assert np.median(seen.growth) == pytest.approx(1.0)
