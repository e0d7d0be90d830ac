# SPDX-License-Identifier: Apache-2.0
"""How far: known errors give known shrinks."""

from __future__ import annotations

import numpy as np
import pytest

from tof_gap.limits.report import ReportLimits, ShrinkLimits
from tof_gap.tell.figures import shrink
from tof_gap.tell.figures.shrink import Errors, HeldOut, Shrink, blocks, measure, surely_removed

RNG = np.random.default_rng(8)
LIMITS = ShrinkLimits()
SHAPE = (64, 64)
HEALTHY2, HEALTHY_MOST2 = LIMITS.healthy_mm**2, LIMITS.healthy_most_mm**2
"""mm^2: what poses take of a healthy camera's errors, usually and at most, stays."""


def maps(bias: float, noise: float, left: float) -> tuple[list, list, list]:  # type: ignore[type-arg]
    """Three views with a bias of which a share is left, and their floor."""
    scatter = [RNG.normal(0, noise, SHAPE) for _ in range(3)]
    return [s + bias for s in scatter], [s + left * bias for s in scatter], [np.full(SHAPE, noise**2)] * 3


def sums(before: list, after: list, floor2: list) -> HeldOut:  # type: ignore[type-arg]
    """Sums over blocks of the usual size."""
    return blocks(before, after, floor2, ReportLimits().block_px)


def test_a_bias_taken_off_by_half_shrinks_the_excess_by_three_quarters() -> None:
    result = measure(sums(*maps(0.004, 0.002, 0.5)), RNG, LIMITS)
    assert result.shrink == pytest.approx(0.75 * 16 / (16 + HEALTHY2), abs=0.03)
    assert result.before.bias == pytest.approx(4.0, abs=0.1)
    assert result.before.rmse == pytest.approx(np.hypot(4, 2), abs=0.1)
    assert result.floor_mm == pytest.approx(2.0)
    assert result.ci95 is not None
    assert result.ci95[0] <= 0.75 <= result.ci95[1]


def test_at_the_floor_there_is_no_shrink_to_state() -> None:
    result = measure(sums(*maps(0.0, 0.002, 1.0)), RNG, LIMITS)
    assert result.shrink is None
    assert result.ci95 is None


def test_what_is_left_may_be_error_of_the_map_and_what_poses_took_would_stay() -> None:
    """A bias of 4 mm of which the map leaves half: the true effect may leave nothing, or more of a healthy camera's errors than usual."""
    result = measure(sums(*maps(0.004, 0.0005, 0.5)), RNG, LIMITS)
    low = (0.75 * 16 - (HEALTHY_MOST2 - HEALTHY2)) / (16 + HEALTHY2)
    assert result.ci95 == pytest.approx((low, 1.0), abs=0.01)


def test_in_a_small_gap_the_interval_reaches_down_to_the_least_healthy_cameras_shrink() -> None:
    """A bias of 1 mm that the map removes: 1 / (1 + 0.3^2) is stated, and 1 / (1 + 0.5^2) lies within."""
    result = measure(sums(*maps(0.001, 0.0002, 0.0)), RNG, LIMITS)
    assert result.shrink == pytest.approx(1 / (1 + HEALTHY2), abs=0.01)
    assert result.ci95 is not None
    assert result.ci95[0] == pytest.approx((1 - (HEALTHY_MOST2 - HEALTHY2)) / (1 + HEALTHY2), abs=0.02)
    assert result.ci95[0] < 1 / (1 + HEALTHY_MOST2)


@pytest.mark.parametrize("bias_mm", [0.8, 2.0, 5.0])
def test_a_healthy_cameras_errors_stay_and_count_the_more_the_smaller_the_gap(bias_mm: float) -> None:
    result = measure(sums(*maps(1e-3 * bias_mm, 0.0005, 0.0)), RNG, LIMITS)
    assert result.shrink == pytest.approx(bias_mm**2 / (bias_mm**2 + HEALTHY2), abs=0.02)


def test_where_nothing_is_removed_nothing_shrinks() -> None:
    result = measure(sums(*maps(0.0006, 0.002, 1.0)), RNG, LIMITS)
    assert (result.shrink, result.ci95) == (0.0, (0.0, 0.0))


def test_a_gap_shrinks_to_nothing_at_most() -> None:
    before, after, floor = maps(0.004, 0.002, 0.0)
    assert measure(sums(before, after, [1.2 * f for f in floor]), RNG, LIMITS).shrink == pytest.approx(1.0, abs=0.03)


def test_pixels_without_depth_do_not_count() -> None:
    before, after, floor = maps(0.004, 0.001, 0.0)
    before[0][:32] = np.nan
    assert sums(before, after, floor).n.sum() == 3 * 64 * 64 - 32 * 64


def test_what_a_map_may_be_wrong_by_may_still_be_won() -> None:
    held_out = sums(*maps(0.004, 0.002, 0.0))
    sure, unsure = (measure(held_out, np.random.default_rng(0), LIMITS, u) for u in (1e-6, 2e-6))
    assert sure.ci95 is not None
    assert unsure.ci95 is not None
    assert unsure.ci95[0] == sure.ci95[0]
    assert unsure.ci95[1] - sure.ci95[1] == pytest.approx(1.0 / (16 + HEALTHY2), rel=0.05)


def test_under_much_scatter_the_interval_says_that_the_floor_is_not_known_better() -> None:
    little, much = (measure(sums(*maps(0.004, noise, 0.0)), RNG, LIMITS).ci95 for noise in (0.0005, 0.008))
    assert little is not None
    assert much is not None
    hidden = (HEALTHY_MOST2 - HEALTHY2) / 4.0**2  # by what a healthy camera errs and poses absorb
    assert np.diff(little) - 2 * hidden < 0.02
    assert np.diff(much) - hidden > 2 * 0.03 * 0.008**2 / 0.004**2


def test_the_interval_is_the_same_however_many_sets_of_blocks_are_drawn_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    held_out, every = sums(*maps(0.004, 0.003, 0.5)), []
    for drawn in (7, LIMITS.rounds):
        monkeypatch.setattr(shrink, "DRAWN", drawn)
        every.append(measure(held_out, np.random.default_rng(3), LIMITS).ci95)
    assert every[0] == pytest.approx(every[1], rel=1e-9)


def test_the_gap_above_the_noise_is_the_root_of_the_difference_of_squares() -> None:
    before, after = sums(*maps(0.004, 0.002, 0.5)).above_mm
    assert before == pytest.approx(4.0, abs=0.1)
    assert after == pytest.approx(2.0, abs=0.1)
    assert sums(*maps(0.004, 0.002, 0.0)).above_mm[1] < 0.3


@pytest.mark.parametrize(("off_edges_mm", "share"), [((4.0, 2.0), 0.75), ((0.0, 0.0), None), (None, None)])
def test_the_share_away_from_edges_is_of_the_squared_gap(off_edges_mm: tuple[float, float] | None, share: float | None) -> None:
    none = Errors(0.0, 0.0, 0.0)
    assert Shrink(none, none, 1.0, None, None, off_edges_mm).off_edges == share


def test_whether_anything_is_removed_depends_on_neither_floor_nor_poses() -> None:
    """0.5 mm beside 1.7 mm of noise: a healthy camera may have as much in its poses, and yet it is there and is removed."""
    before, after, floor2 = maps(0.0005, 0.0017, 0.0)
    small = measure(sums(before, after, floor2), RNG, LIMITS)
    assert small.shrink is not None
    assert small.ci95 is not None
    assert small.ci95[0] < 0.0
    assert small.shrink > 0.5
    assert surely_removed(sums(before, after, floor2), RNG, LIMITS)
    assert not surely_removed(sums(after, before, floor2), RNG, LIMITS)
    assert not surely_removed(sums(before, before, floor2), RNG, LIMITS)


def test_what_one_block_alone_shows_may_be_chance() -> None:
    before, after, floor2 = maps(0.0, 0.0017, 0.0)
    before[0][:8, :8] += 0.02
    assert not surely_removed(sums(before, after, floor2), RNG, LIMITS)
