# SPDX-License-Identifier: Apache-2.0
"""Of views in motion some are used, spread over the bag; of those at rest all."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tests.tof_gap.quiet_views import views
from tof_core.capture import RobotPose
from toftwin.thinned import thinned

if TYPE_CHECKING:
    from collections.abc import Iterator

    from tof_core.capture import View

VIEW = views(np.random.default_rng(1))[0].view
REST, DRIVE = np.zeros(6), np.array([0.15, 0, 0, 0, 0, 0])


def recorded(*twists: np.ndarray, uneven: frozenset[int] = frozenset()) -> Iterator[View]:
    """A bag with a view of each of these velocities; the stamps count them. In the `uneven` ones the velocity changes."""
    for n, twist in enumerate(twists):
        yield replace(VIEW, stamp_ns=n, robot=RobotPose(np.eye(4), np.eye(4), twist=twist, uneven=n in uneven))


def kept(*twists: np.ndarray, moving: int) -> list[int]:
    """Places in the bag of the views that are used."""
    return [v.stamp_ns for v in thinned(recorded(*twists), moving)]


def test_all_views_at_rest_are_used_and_few_in_motion_too() -> None:
    assert kept(REST, DRIVE, REST, DRIVE, moving=2) == [0, 1, 2, 3]


@pytest.mark.parametrize("frames", [5, 8, 9, 40, 1000])
def test_many_views_in_motion_are_thinned_evenly(frames: int) -> None:
    places = kept(*[DRIVE] * frames, moving=4)
    assert len(places) == 4
    steps = np.diff(places)
    assert steps.max() <= 2 * steps.min()
    assert places[0] == 0
    assert places[-1] >= 0.7 * (frames - 1)


def test_the_order_of_the_bag_stays() -> None:
    twists = [REST, *[DRIVE] * 10, REST, *[DRIVE] * 10, REST]
    places = kept(*twists, moving=3)
    assert places == sorted(places)
    assert {0, 11, 22} <= set(places)
    assert len(places) == 6


def test_the_trembling_of_an_arm_at_rest_is_no_motion() -> None:
    trembles = np.array([0.004, 0, 0, 0, 0, np.radians(0.4)])
    assert kept(*[trembles] * 9, moving=2) == list(range(9))


def test_views_in_which_the_camera_starts_or_stops_are_left_out() -> None:
    views = recorded(REST, DRIVE, DRIVE, DRIVE, REST, uneven=frozenset({1}))
    assert [v.stamp_ns for v in thinned(views, 9)] == [0, 2, 3, 4]


def test_where_most_views_are_of_that_kind_they_are_used() -> None:
    views = recorded(REST, DRIVE, DRIVE, DRIVE, REST, uneven=frozenset({1, 3}))
    assert [v.stamp_ns for v in thinned(views, 9)] == [0, 1, 2, 3, 4]
