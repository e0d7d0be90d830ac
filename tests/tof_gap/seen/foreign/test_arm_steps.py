# SPDX-License-Identifier: Apache-2.0
"""Steps along the optical axis that follow distance and brightness of the views."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tests.tof_gap.quiet_views import SHAPE, VIEWS, views
from tof_core.se3 import exp
from tof_gap.seen.foreign.arm_steps import contents, following, means, over_prior, sagging

if TYPE_CHECKING:
    from tof_core.arrays import Float

ONE_STATION = np.zeros(VIEWS, np.int64)
SEEN = views(np.random.default_rng(1))
"""Each view is 5 cm farther than the one before."""
OF_VIEW = contents(SEEN)


def test_steps_that_grow_with_the_distance_of_the_views_are_not_by_chance() -> None:
    follow = np.linspace(-1.0, 1.0, VIEWS) + 0.1 * np.random.default_rng(2).standard_normal(VIEWS)
    found = following(follow, OF_VIEW, ONE_STATION)
    assert found.chance < 1e-5
    assert found.size == pytest.approx(np.linspace(-1.0, 1.0, VIEWS).std(), rel=0.1)


def test_steps_of_an_arm_follow_no_view() -> None:
    chances = [following(np.random.default_rng(k).standard_normal(VIEWS), OF_VIEW, ONE_STATION).chance for k in range(200)]
    assert np.mean(np.array(chances) < 0.1) == pytest.approx(0.1, abs=0.06), "a probability, of steps that are independent of the views"


def test_the_mean_of_a_station_is_an_error_of_its_base() -> None:
    two = np.repeat([0, 1], VIEWS // 2)
    steps = 5.0 * two + 0.1 * np.random.default_rng(4).standard_normal(VIEWS)
    assert following(steps, OF_VIEW, ONE_STATION).chance < 0.01, "the second half of the views is farther"
    assert following(steps, OF_VIEW, two).chance > 0.05


def test_too_few_views_and_an_arm_without_errors_show_nothing() -> None:
    assert following(np.arange(3.0), OF_VIEW[:3], ONE_STATION[:3]).chance == 1.0
    assert following(np.zeros(VIEWS), OF_VIEW, ONE_STATION).chance == 1.0


def test_contents_are_distance_and_brightness_and_a_view_without_pixels_does_not_count() -> None:
    assert np.diff(OF_VIEW[:, 0]) == pytest.approx(np.full(VIEWS - 1, 0.05), rel=0.15), "along slanted rays, a little more"
    assert np.all(np.diff(OF_VIEW[:, 1]) < 0), "farther is darker"
    blind = replace(SEEN[0], smooth=np.zeros(SHAPE, bool))
    assert np.isnan(contents([blind])).all()
    follow = np.linspace(-1.0, 1.0, VIEWS) + 0.1 * np.random.default_rng(2).standard_normal(VIEWS)
    follow[0] = 50.0
    assert following(follow, contents([blind, *SEEN[1:]]), ONE_STATION).chance < 1e-4


def test_the_mean_of_a_map_is_that_of_the_smooth_pixels() -> None:
    maps = [np.where(v.smooth, 0.001 * k, np.nan) for k, v in enumerate(SEEN)]
    assert means(SEEN, maps)[:, 0] == pytest.approx(0.001 * np.arange(VIEWS))


def nodding(angles: Float) -> Float:
    """(V, 4, 4) cameras of a hand that turns about its horizontal axis."""
    return np.stack([exp([0.0, 0.0, 1.0, angle, 0.0, 0.0]) for angle in angles])


def test_a_camera_that_its_weight_turns_follows_lever_times_down() -> None:
    """The hand nods; the centre of mass lies before the mount, along the optical axis, so that the camera turns about its x axis."""
    angles = np.linspace(-0.8, 0.8, VIEWS)
    rng, cameras = np.random.default_rng(6), nodding(angles)
    turns = rng.normal(0, 0.1, (VIEWS, 3))
    healthy = sagging(turns, cameras, ONE_STATION)
    assert healthy.chance > 0.01
    assert healthy.size < 0.1
    down = -cameras[:, 2, :3]
    turns += np.cross([0.0, 0.5, 1.0], down)
    found = sagging(turns, cameras, ONE_STATION)
    assert found.chance < 1e-5
    assert found.size == pytest.approx(np.std(0.5 * np.cos(angles) - np.sin(angles)) / np.sqrt(3), abs=0.05)
    upright = np.tile(np.eye(4), (VIEWS, 1, 1))
    assert sagging(turns, upright, ONE_STATION).chance == 1.0, "one attitude shows nothing"


def test_turns_that_no_weight_makes_are_no_sag() -> None:
    """Turns from side to side that follow the nod: a lever that made them would roll the camera more."""
    cameras = nodding(np.linspace(-0.8, 0.8, VIEWS))
    turns = np.random.default_rng(6).normal(0, 0.1, (VIEWS, 3))
    turns[:, 1] += np.sin(np.linspace(-0.8, 0.8, VIEWS))
    assert sagging(turns, cameras, ONE_STATION).size < 0.1


def test_the_error_of_a_station_s_base_is_no_sag() -> None:
    station = np.arange(VIEWS) // (VIEWS // 2)
    cameras = nodding(np.where(station == 0, -0.5, 0.5))
    turns = np.random.default_rng(6).normal(0, 0.1, (VIEWS, 3))
    turns[station == 1, 0] += 2.0
    assert sagging(turns, cameras, station).size < 0.1


def test_arm_errors_exceed_the_prior_if_positions_and_turns_do() -> None:
    sd = np.broadcast_to([1e-3] * 3 + [2e-3] * 3, (200, 6))
    drawn = np.random.default_rng(7).standard_normal((200, 6)) * sd
    assert over_prior(drawn, sd) == pytest.approx(1.0, abs=0.08)
    assert over_prior(3.0 * drawn, sd) == pytest.approx(3.0, abs=0.25)
    along = drawn * [1.0, 1.0, 20.0, 1.0, 1.0, 1.0]
    assert over_prior(along, sd) == pytest.approx(1.0, abs=0.08), "foreign light moves the camera along its axis"
