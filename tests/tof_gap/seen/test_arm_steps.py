# SPDX-License-Identifier: Apache-2.0
"""Steps along the optical axis that follow distance and brightness of the views."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.tof_gap.quiet_views import SHAPE, VIEWS, views
from tof_core.se3 import exp
from tof_gap.seen.arm_steps import chance_of_following, chance_of_sagging, contents, means, over_prior

ONE_STATION = np.zeros(VIEWS, np.int64)
SEEN = views(np.random.default_rng(1))
"""Each view is 5 cm farther than the one before."""
OF_VIEW = contents(SEEN)


def test_steps_that_grow_with_the_distance_of_the_views_are_not_by_chance() -> None:
    follow = np.linspace(-1.0, 1.0, VIEWS) + 0.1 * np.random.default_rng(2).standard_normal(VIEWS)
    assert chance_of_following(follow, OF_VIEW, ONE_STATION) < 1e-5


def test_steps_of_an_arm_follow_no_view() -> None:
    chances = [chance_of_following(np.random.default_rng(k).standard_normal(VIEWS), OF_VIEW, ONE_STATION) for k in range(200)]
    assert np.mean(np.array(chances) < 0.1) == pytest.approx(0.1, abs=0.06), "a probability, of steps that are independent of the views"


def test_the_mean_of_a_station_is_an_error_of_its_base() -> None:
    two = np.repeat([0, 1], VIEWS // 2)
    steps = 5.0 * two + 0.1 * np.random.default_rng(4).standard_normal(VIEWS)
    assert chance_of_following(steps, OF_VIEW, ONE_STATION) < 0.01, "the second half of the views is farther"
    assert chance_of_following(steps, OF_VIEW, two) > 0.05


def test_too_few_views_and_an_arm_without_errors_show_nothing() -> None:
    assert chance_of_following(np.arange(3.0), OF_VIEW[:3], ONE_STATION[:3]) == 1.0
    assert chance_of_following(np.zeros(VIEWS), OF_VIEW, ONE_STATION) == 1.0


def test_contents_are_distance_and_brightness_and_a_view_without_pixels_does_not_count() -> None:
    assert np.diff(OF_VIEW[:, 0]) == pytest.approx(np.full(VIEWS - 1, 0.05), rel=0.15), "along slanted rays, a little more"
    assert np.all(np.diff(OF_VIEW[:, 1]) < 0), "farther is darker"
    blind = replace(SEEN[0], smooth=np.zeros(SHAPE, bool))
    assert np.isnan(contents([blind])).all()
    follow = np.linspace(-1.0, 1.0, VIEWS) + 0.1 * np.random.default_rng(2).standard_normal(VIEWS)
    follow[0] = 50.0
    assert chance_of_following(follow, contents([blind, *SEEN[1:]]), ONE_STATION) < 1e-4


def test_the_mean_of_a_map_is_that_of_the_smooth_pixels() -> None:
    maps = [np.where(v.smooth, 0.001 * k, np.nan) for k, v in enumerate(SEEN)]
    assert means(SEEN, maps)[:, 0] == pytest.approx(0.001 * np.arange(VIEWS))


def test_a_camera_that_its_weight_turns_follows_the_attitude_of_the_hand() -> None:
    """The hand turns about its horizontal axis; the camera nods by what its weight does across the mount."""
    rng, nod = np.random.default_rng(6), np.linspace(-0.8, 0.8, VIEWS)
    cameras = np.stack([exp([0.0, 0.0, 1.0, angle, 0.0, 0.0]) for angle in nod])
    turns = rng.normal(0, 0.1, (VIEWS, 3))
    assert chance_of_sagging(turns, cameras, ONE_STATION) > 0.01
    turns[:, 0] += np.sin(nod)
    assert chance_of_sagging(turns, cameras, ONE_STATION) < 1e-5
    upright = np.tile(np.eye(4), (VIEWS, 1, 1))
    assert chance_of_sagging(turns, upright, ONE_STATION) == 1.0, "one attitude shows nothing"


def test_a_mount_that_gives_way_about_two_axes_is_known_by_both() -> None:
    """Turns of 0.9 of the arm's standard deviation about each of two axes: one alone may be chance in one of a hundred sessions."""
    rng = np.random.default_rng(11)
    nod, roll = rng.uniform(-0.6, 0.6, (2, VIEWS))
    cameras = np.tile(np.eye(4), (VIEWS, 1, 1))
    cameras[:, :3, :3] = Rotation.from_euler("zxy", np.column_stack([roll, nod, np.zeros(VIEWS)])).as_matrix()
    one = rng.standard_normal((VIEWS, 3)) * 0.3
    one[:, 0] += 1.2 * np.sin(nod)
    both = one.copy()
    both[:, 1] += 1.2 * np.sin(nod)
    alone, together = (chance_of_sagging(turns, cameras, ONE_STATION) for turns in (one, both))
    assert together < 0.1 * alone


def test_arm_errors_exceed_the_prior_if_positions_and_turns_do() -> None:
    sd = np.broadcast_to([1e-3] * 3 + [2e-3] * 3, (200, 6))
    drawn = np.random.default_rng(7).standard_normal((200, 6)) * sd
    assert over_prior(drawn, sd) == pytest.approx(1.0, abs=0.08)
    assert over_prior(3.0 * drawn, sd) == pytest.approx(3.0, abs=0.25)
    along = drawn * [1.0, 1.0, 20.0, 1.0, 1.0, 1.0]
    assert over_prior(along, sd) == pytest.approx(1.0, abs=0.08), "foreign light moves the camera along its axis"
