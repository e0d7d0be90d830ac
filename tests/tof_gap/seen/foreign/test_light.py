# SPDX-License-Identifier: Apache-2.0
"""Another camera's light: captures that are off along the view and not across it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from tests.tof_gap.quiet_views import SHAPE, VIEWS, views
from tof_core.se3 import exp
from tof_gap.limits.foreign import ForeignLightLimits
from tof_gap.seen.foreign.light import along_the_view, beside_light, drifts_by_chance, field, foreign_light, in_most_views
from tof_sensor.effects.interference import Interference
from tof_sensor.geometry import pose_columns

if TYPE_CHECKING:
    from tof_core.arrays import Float

LIMITS = ForeignLightLimits()
SD = np.tile([0.001, 0.001, 0.001, 0.002, 0.002, 0.002], (VIEWS, 1))
COVS = np.tile(np.diag(np.full(6, 1e-8)), (VIEWS, 1, 1))
"""Of poses that the views determine to 0.1 mm and 0.1 mrad."""


def arms(across_m: float, along_m: float) -> Float:
    """Arm errors of these sizes, drawn anew in each view."""
    size = np.array([across_m, across_m, along_m, 0.002, 0.002, 0.002])
    return np.asarray(np.random.default_rng(3).normal(0, 1, (VIEWS, 6)) * size)


def test_captures_that_are_off_along_the_view_and_have_fields_show_interference() -> None:
    errors = arms(0.001, 0.004)
    assert foreign_light(views(np.random.default_rng(1)), errors, SD, COVS, LIMITS) is None, "a mount that gives way leaves no field"
    found = foreign_light(views(np.random.default_rng(1), own_fields(0.002)), errors, SD, COVS, LIMITS, named_m=0.02)
    assert found is not None
    assert along_the_view(errors, SD, LIMITS)
    assert isinstance(found.effect, Interference)
    assert found.effect.burst_m == pytest.approx(np.sqrt(np.mean(errors[:, 2] ** 2)))
    assert found.posed_m == found.effect.burst_m
    assert found.structure, "an effect without a name may shift captures too"


@pytest.mark.parametrize(("across_m", "along_m"), [(0.001, 0.001), (0.004, 0.004), (0.0003, 0.001)])
def test_an_arm_as_good_as_stated_or_bad_in_all_directions_shows_none(across_m: float, along_m: float) -> None:
    assert foreign_light(views(np.random.default_rng(1)), arms(across_m, along_m), SD, COVS, LIMITS) is None
    assert not along_the_view(arms(across_m, along_m), SD, LIMITS)


def test_steps_along_the_view_are_light_as_far_as_they_exceed_the_arm() -> None:
    """Steps of 4 mm where the arm errs by 1.5 mm: 1 - (1.5 / 4)^2 of each is taken back along the optical axis."""
    cameras = np.stack([exp([0.1 * k, 0.2, 0.5, 0.3 * k, 0.1, -0.2]) for k in range(3)])
    steps, sd = np.zeros((3, 6)), np.full((3, 6), 0.0015)
    steps[:, 2], steps[:, 0] = [0.004, -0.004, 0.004], 0.001
    moved = cameras @ np.stack([exp([0, 0, z, 0, 0, 0]) for z in (1 - (1.5 / 4) ** 2) * steps[:, 2]])
    np.testing.assert_allclose(beside_light(moved, steps, sd, 0.004), cameras, atol=1e-12)
    np.testing.assert_array_equal(beside_light(moved, steps, sd, 0.001), moved)
    np.testing.assert_array_equal(beside_light(moved, steps, sd, 0.0), moved)


def own_fields(size_m: float) -> Float:
    """(V, H, W) metres along the ray: a smooth field of its own in every view."""
    row, column = np.mgrid[: SHAPE[0], : SHAPE[1]] / np.array(SHAPE)[:, None, None] - 0.5
    turns = np.random.default_rng(4).uniform(0, 2 * np.pi, (VIEWS, 1, 1))
    return np.asarray(size_m * np.sin(turns + 2.0 * row + 3.0 * column))


@pytest.mark.parametrize(
    ("along_m", "field_m", "found"),
    [
        (0.0015, 0.002, True),  # Weak foreign light: within the arm's prior, and a field in every view.
        (0.0015, 0.0, False),  # An arm that errs within its prior.
        (0.0015, 0.004, False),  # Fields larger than the steps that would absorb most of the light: another error.
        (0.0006, 0.002, False),  # Fields of the views alone: any unknown effect leaves them.
    ],
)
def test_weak_foreign_light_needs_arms_and_fields(along_m: float, field_m: float, *, found: bool) -> None:
    seen = views(np.random.default_rng(1), own_fields(field_m))
    assert (foreign_light(seen, arms(0.0006, along_m), SD, COVS, LIMITS) is not None) is found


@pytest.mark.parametrize(("along_m", "found"), [(0.0015, False), (0.004, True)])
def test_where_views_do_not_show_errors_across_light_must_exceed_the_arm(along_m: float, *, found: bool) -> None:
    """Cameras that may slide across the view by 1 mm: their estimated errors there are near zero."""
    covs = np.tile(np.diag([1e-6, 1e-6, 1e-8, 1e-8, 1e-8, 1e-8]), (VIEWS, 1, 1))
    seen = views(np.random.default_rng(1), own_fields(0.002))
    assert (foreign_light(seen, arms(0.0001, along_m), SD, covs, LIMITS) is not None) is found


def test_the_field_of_a_view_is_what_varies_smoothly_over_it() -> None:
    row, column = np.mgrid[: SHAPE[0], : SHAPE[1]]
    smooth = 0.003 + 0.004 * (row / SHAPE[0] - 0.5) - 0.002 * (column / SHAPE[1] - 0.5)
    (view, *_) = views(np.random.default_rng(1), np.broadcast_to(smooth, (VIEWS, *SHAPE)))
    error = (field(view, LIMITS) * view.frame.length - smooth)[view.smooth]
    # Thirteen terms of some 9600 pixels with 4 mm of noise: sqrt(13 / 9600) * 4 mm = 0.15 mm.
    assert np.sqrt(np.mean(error**2)) < 2.5e-4


@pytest.mark.parametrize(("named_m", "found"), [(0.005, True), (0.02, False)])
def test_fields_that_inexact_maps_of_named_effects_may_leave_are_no_sign(named_m: float, *, found: bool) -> None:
    # Fields of 1.4 mm RMS beside 5 and 20 mm of named effects.
    seen = views(np.random.default_rng(1), own_fields(0.002))
    assert (foreign_light(seen, arms(0.0006, 0.0015), SD, COVS, LIMITS, named_m) is not None) is found


def test_fields_that_poses_make_are_no_sign() -> None:
    """Poses that follow an error of the CAD are off by 2 mm and 2 mrad, and a view of a plane shows a smooth field of 1.5 mm."""
    frame = views(np.random.default_rng(1))[0].frame
    off = np.random.default_rng(6).normal(0, 0.002, (VIEWS, 6))
    errors = np.einsum("hwi,vi->vhw", pose_columns(frame), off) * frame.length
    seen = views(np.random.default_rng(1), errors)
    assert in_most_views(seen, [field(v, LIMITS) for v in seen], LIMITS, 0.0)
    assert foreign_light(seen, arms(0.0006, 0.0015), SD, COVS, LIMITS) is None


@pytest.mark.parametrize(
    ("lines_m", "found"),
    [(np.full(VIEWS, 0.0005), True), (np.full(VIEWS, 0.002), False), (np.where(np.arange(VIEWS) < VIEWS // 2, 0.002, 0.0), False)],
    ids=["small", "large", "large in half of the views"],
)
def test_fields_that_the_noise_of_lines_makes_are_no_sign(lines_m: Float, *, found: bool) -> None:
    seen = views(np.random.default_rng(1), own_fields(0.002))
    assert (foreign_light(seen, arms(0.0006, 0.0015), SD, COVS, LIMITS, lines_m=lines_m) is not None) is found


@pytest.mark.parametrize(
    ("warmup_m", "posed_m", "by_chance"),
    [
        (0.004, 0.0046, True),  # A drift of 1.2 mm RMS about its mean beside captures that foreign light moves by 4.6 mm.
        (0.060, 0.0046, False),
        (0.004, 0.0002, False),
        (0.0001, 0.0, False),  # Nothing moves captures.
    ],
)
def test_a_drift_within_what_foreign_light_moves_captures_by_is_chance(warmup_m: float, posed_m: float, *, by_chance: bool) -> None:
    drift = [np.full(SHAPE, warmup_m * np.exp(-v / 3.0)) for v in range(VIEWS)]
    assert drifts_by_chance(drift, posed_m, LIMITS) is by_chance
