# SPDX-License-Identifier: Apache-2.0
"""A bias that the captures of a dwell share is no light of another clock."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tests.tof_gap.quiet_views import SHAPE, VIEWS, views
from tof_gap.limits.foreign import RepeatedLimits
from tof_gap.seen.foreign.repeated import repeated

if TYPE_CHECKING:
    from tof_core.arrays import Float
    from tof_gap.seen.evidence.view import ViewEvidence

LIMITS = RepeatedLimits()
CAPTURES = 4
STRIPES = np.sin(np.arange(SHAPE[0]) / 2.0)[:, None] * np.ones(SHAPE)


def dwells(depth: Float, noise_m: float = 1e-3) -> list[ViewEvidence]:
    """Views with the standard error of captures `depth` (V, captures, H, W), of which neighbours show the noise of one, `noise_m`."""
    error = (depth.std(axis=1, ddof=1) / np.sqrt(depth.shape[1])).astype(np.float32)
    seen = views(np.random.default_rng(0))
    sigma = np.full(SHAPE, noise_m / np.sqrt(depth.shape[1]))
    return [replace(v, view=replace(v.view, captures=depth.shape[1], sigma=e), sigma=sigma) for v, e in zip(seen, error, strict=True)]


@pytest.mark.parametrize(("own_phase", "same"), [(True, False), (False, True)])
def test_a_new_phase_in_each_capture_is_noise_as_large_as_the_bias(own_phase: bool, same: bool) -> None:  # noqa: FBT001
    rng = np.random.default_rng(1)
    strength = rng.choice([-1.0, 1.0], (VIEWS, CAPTURES, 1, 1)) if own_phase else np.ones((VIEWS, CAPTURES, 1, 1))
    captures = 0.004 * strength * STRIPES + rng.normal(0, 1e-3, (VIEWS, CAPTURES, *SHAPE))
    bias = 0.004 * strength.mean(axis=1) * STRIPES
    assert repeated(dwells(captures), bias, LIMITS) == same


@pytest.mark.parametrize(("step_m", "same"), [(2e-4, False), (2e-3, True)])
def test_steps_of_the_camera_count_as_bias(step_m: float, same: bool) -> None:  # noqa: FBT001
    captures = np.random.default_rng(2).normal(0, 1e-3, (VIEWS, CAPTURES, *SHAPE))
    assert repeated(dwells(captures), np.zeros((VIEWS, *SHAPE)), LIMITS, np.full(VIEWS, step_m**2)) == same


@pytest.mark.parametrize(("own_phase", "same"), [(True, False), (False, True)])
def test_weak_stripes_in_some_views_are_compared_with_the_views_without_them(own_phase: bool, same: bool) -> None:  # noqa: FBT001
    """Stripes of 2 mm in three of the views, beside noise of the mean of 2 mm: less than captures differ by noise."""
    rng = np.random.default_rng(3)
    strength = rng.choice([-1.0, 1.0], (VIEWS, CAPTURES, 1, 1)) if own_phase else np.ones((VIEWS, CAPTURES, 1, 1))
    strength[3:] = 0.0
    captures = 0.003 * strength * STRIPES + rng.normal(0, 4e-3, (VIEWS, CAPTURES, *SHAPE))
    seen = dwells(captures, 4e-3)
    bias = 0.003 / (2.0 if own_phase else 1.0) * np.abs(np.sign(strength[:, 0])) * STRIPES
    assert not repeated(seen, 0.0 * bias, LIMITS)
    assert repeated(seen, bias, LIMITS) == same


def test_single_captures_and_views_without_the_bias_are_not_compared() -> None:
    captures = np.random.default_rng(2).normal(0, 1e-3, (VIEWS, CAPTURES, *SHAPE))
    assert not repeated(views(np.random.default_rng(0)), np.full((VIEWS, *SHAPE), 0.01), LIMITS)
    assert not repeated(dwells(captures), np.zeros((VIEWS, *SHAPE)), LIMITS)
    assert not repeated(dwells(captures), None, LIMITS)
    one = np.zeros((VIEWS, *SHAPE))
    one[3] = 0.01
    assert repeated(dwells(captures), one, LIMITS)
