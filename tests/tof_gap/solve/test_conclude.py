# SPDX-License-Identifier: Apache-2.0
"""What a closed solution states: effects beyond a healthy camera's, and what noise and loss are read from."""

from __future__ import annotations

import numpy as np
import pytest

from tests.tof_gap.quiet_views import SHAPE, VIEWS, views
from tof_gap.limits.solve import SelectLimits
from tof_gap.seen.evidence.residual import less, noise_again
from tof_gap.solve.conclude import _small


def test_columns_of_a_pattern_are_no_noise_once_they_are_taken_off() -> None:
    """Offsets of columns, 6 mm RMS: to the neighbours in a row they are noise."""
    columns = np.broadcast_to(np.random.default_rng(4).normal(0, 0.006, SHAPE[1]), (VIEWS, *SHAPE))
    quiet, session = views(np.random.default_rng(3)), views(np.random.default_rng(3), columns)
    alone = [c / v.frame.length for c, v in zip(columns, session, strict=True)]
    left = less(session, [alone])
    for before, after, photons in zip(left, noise_again(left), quiet, strict=True):
        assert np.median(before.sigma) > 1.2 * np.median(photons.sigma)
        np.testing.assert_allclose(after.sigma, photons.sigma, rtol=1e-3)


@pytest.mark.parametrize(("size_m", "small"), [(0.5e-3, False), (0.3e-3, True)])
def test_motion_counts_from_four_tenths_of_a_millimetre_on(size_m: float, *, small: bool) -> None:
    maps = {"motion": [np.full((2, 2), size_m)], "wiggling": [np.full((2, 2), 0.9e-3)]}
    found = _small({"motion": size_m, "wiggling": 0.9e-3}, maps, (), SelectLimits())
    assert found == ({"motion", "wiggling"} if small else {"wiggling"})


def test_motion_that_makes_little_of_all_maps_is_small() -> None:
    maps = {"motion": [np.full((2, 2), 2e-3)], "wiggling": [np.full((2, 2), 20e-3)]}
    assert _small({"motion": 2e-3, "wiggling": 20e-3}, maps, (), SelectLimits()) == {"motion"}


def test_errors_without_a_name_are_judged_together() -> None:
    sizes = {"wiggling": 0.9e-3, "region": 0.4e-3, "y_m": 0.4e-3}
    assert _small(sizes, {}, ("region", "y_m"), SelectLimits()) == {"wiggling"}
    assert _small(sizes, {}, ("region",), SelectLimits()) == {"wiggling", "region", "y_m"}


@pytest.mark.parametrize(("size_m", "small"), [(0.6e-3, False), (0.4e-3, True)])
def test_an_error_without_a_name_counts_from_half_a_millimetre_on(size_m: float, *, small: bool) -> None:
    assert _small({"ghost": size_m}, {}, ("ghost",), SelectLimits()) == ({"ghost"} if small else set())
