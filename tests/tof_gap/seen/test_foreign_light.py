# SPDX-License-Identifier: Apache-2.0
"""Another camera's light: captures that are off along the view and not across it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from tests.tof_gap.quiet_views import SHAPE, VIEWS, views
from tof_gap.limits.seen import ForeignLightLimits
from tof_gap.seen.foreign_light import field, foreign_light
from tof_sensor.effects.interference import Interference

if TYPE_CHECKING:
    from tof_core.arrays import Float

LIMITS = ForeignLightLimits()
SD = np.tile([0.001, 0.001, 0.001, 0.002, 0.002, 0.002], (VIEWS, 1))


def arms(across_m: float, along_m: float) -> Float:
    """Arm errors of these sizes, drawn anew in each view."""
    size = np.array([across_m, across_m, along_m, 0.002, 0.002, 0.002])
    return np.asarray(np.random.default_rng(3).normal(0, 1, (VIEWS, 6)) * size)


def test_captures_that_are_off_along_the_view_alone_show_interference() -> None:
    errors = arms(0.001, 0.004)
    found = foreign_light(views(np.random.default_rng(1)), errors, SD, LIMITS)
    assert found is not None
    assert isinstance(found.effect, Interference)
    assert found.effect.burst_m == pytest.approx(np.sqrt(np.mean(errors[:, 2] ** 2)))
    assert found.posed_m == found.effect.burst_m


@pytest.mark.parametrize(("across_m", "along_m"), [(0.001, 0.001), (0.004, 0.004), (0.0003, 0.001)])
def test_an_arm_as_good_as_stated_or_bad_in_all_directions_shows_none(across_m: float, along_m: float) -> None:
    assert foreign_light(views(np.random.default_rng(1)), arms(across_m, along_m), SD, LIMITS) is None


def test_the_field_of_a_view_is_what_varies_smoothly_over_it() -> None:
    row, column = np.mgrid[: SHAPE[0], : SHAPE[1]]
    smooth = 0.003 + 0.004 * (row / SHAPE[0] - 0.5) - 0.002 * (column / SHAPE[1] - 0.5)
    (view, *_) = views(np.random.default_rng(1), np.broadcast_to(smooth, (VIEWS, *SHAPE)))
    np.testing.assert_allclose((field(view, LIMITS) * view.frame.length)[view.smooth], smooth[view.smooth], atol=4e-4)
