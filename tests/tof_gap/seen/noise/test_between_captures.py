# SPDX-License-Identifier: Apache-2.0
"""Captures of a dwell that differ as a whole: by another camera's light, or by a hand that sways."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from scipy.ndimage import uniform_filter

from tests.tof_gap import two_walls
from tests.tof_gap.quiet_views import SHAPE, VIEWS
from tests.tof_gap.two_walls import NOISE_M
from tof_gap.limits.noise import NoiseLimits
from tof_gap.seen.evidence.correlation import NoiseCorrelation
from tof_gap.seen.finding import Finding
from tof_gap.seen.noise.between_captures import as_captures_step, stepping_captures
from tof_gap.seen.noise.effects import noise_effects
from tof_sensor.effects.interference import Interference
from tof_sensor.geometry import pose_columns

if TYPE_CHECKING:
    from collections.abc import Callable

    from tof_core.arrays import Float
    from tof_gap.seen.evidence.view import ViewEvidence

LIMITS = NoiseLimits()
CAPTURES = 3


def by_light(strength: float) -> Callable[[ViewEvidence], Float]:
    """(H, W) m^2 along the ray between captures by foreign light: `strength` times the usual noise at the view's median way."""
    return lambda v: (strength * NOISE_M * v.frame.surroundings_m2 / np.median(v.frame.surroundings_m2[v.smooth])) ** 2


def by_sway(turn_rad: float, step_m: float) -> Callable[[ViewEvidence], Float]:
    """(H, W) m^2 along the ray between captures of a hand that turns and steps, about and along each axis."""
    sd = np.array([step_m] * 3 + [turn_rad] * 3)
    return lambda v: np.asarray((((pose_columns(v.frame) * v.frame.length[..., None]) * sd) ** 2).sum(axis=-1))


def dwells(steps2: Callable[[ViewEvidence], Float], stepping: int = VIEWS) -> list[ViewEvidence]:
    """Dwells before two walls, whose captures differ by the noise of pixels, and in the first `stepping` by steps of the whole image."""
    out = []
    for number, v in enumerate(two_walls.session()):
        between2 = NOISE_M**2 + (steps2(v) if number < stepping else 0.0)
        view = replace(
            v.view,
            captures=CAPTURES,
            sigma=(np.sqrt(between2 / CAPTURES) / v.frame.length).astype(np.float32),
            count=np.full(SHAPE, CAPTURES, np.uint16),
        )
        out.append(replace(v, view=view, residual=v.residual / np.sqrt(CAPTURES), sigma=v.sigma / np.sqrt(CAPTURES)))
    return out


def test_captures_that_step_in_proportion_to_the_way_of_the_light_are_interference() -> None:
    found = stepping_captures(dwells(by_light(1.5)), LIMITS)
    assert found is not None
    assert isinstance(found.effect, Interference)
    assert f"in {VIEWS} of {VIEWS} dwells" in found.note
    assert found.effect.burst_m == pytest.approx(1.5 * NOISE_M, rel=0.2)
    (named,) = noise_effects(dwells(by_light(1.5)), LIMITS)
    assert named.name == "interference"


@pytest.mark.parametrize(("found_m", "stated_m"), [(0.1 * NOISE_M, 1.5 * NOISE_M), (3.0 * NOISE_M, 3.0 * NOISE_M)])
def test_foreign_light_is_as_large_as_captures_step_where_poses_and_means_hide_it(found_m: float, stated_m: float) -> None:
    found = Finding(Interference(burst_m=found_m, duty=0.8), 0.95)
    stated = as_captures_step(found, dwells(by_light(1.5)), LIMITS).effect
    assert isinstance(stated, Interference)
    assert stated.burst_m == pytest.approx(stated_m, rel=0.2)
    assert stated.duty == 0.8
    assert as_captures_step(found, dwells(by_light(0.0)), LIMITS) is found


@pytest.mark.parametrize(
    "quiet",
    [
        pytest.param(dwells(by_light(0.0)), id="captures that differ by the noise of pixels"),
        pytest.param(dwells(by_light(0.3)), id="steps of a third of the noise"),
        pytest.param(dwells(by_sway(0.006, 0.002)), id="a hand that sways"),
        pytest.param(dwells(by_light(1.5), stepping=VIEWS // 3), id="steps in few dwells"),
        pytest.param(list(two_walls.session()), id="single captures"),
    ],
)
def test_other_captures_are_none(quiet: list[ViewEvidence]) -> None:
    assert stepping_captures(quiet, LIMITS) is None


def test_captures_that_differ_by_what_many_neighbours_share_do_not_step() -> None:
    """A camera that interpolates between projected dots shares noise over 5 x 5 pixels, more of it in weak light: captures differ by all of it."""
    views = []
    for number, v in enumerate(dwells(by_light(3.0))):
        sd = np.sqrt(by_light(3.0)(v) / CAPTURES) / v.frame.length
        shared = sd * 5.0 * uniform_filter(np.random.default_rng(number).normal(size=SHAPE), 5)
        views.append(replace(v, residual=shared, sigma=sd * 0.37))
    assert stepping_captures(views, LIMITS) is None
    white = [replace(v, residual=v.sigma * np.random.default_rng(2).normal(size=SHAPE)) for v in views]
    assert stepping_captures(white, LIMITS) is not None
    known_by_captures = NoiseCorrelation(lever=3.0, line=8.0, area=64.0, growth=2.0)
    assert stepping_captures([replace(v, correlation=known_by_captures) for v in white], LIMITS) is None
