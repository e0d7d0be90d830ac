# SPDX-License-Identifier: Apache-2.0
"""Loss beside the steps of a fixed pattern: a filter's, whatever the light, and dropout only where the smooth half loses as much."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from scipy.ndimage import maximum_filter, minimum_filter

from tests.tof_gap.quiet_views import SHAPE, SIGMA_M, VIEWS, views
from tof_core.reasons import Reason
from tof_gap.limits.missing import MissingLimits
from tof_gap.seen.evidence.correlation import NoiseCorrelation
from tof_gap.seen.missing.effects import missing_effects
from tof_gap.seen.missing.steps import beside_steps
from tof_sensor.effects.dropout import Dropout

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from tof_core.arrays import Float, Mask
    from tof_gap.seen.evidence.view import ViewEvidence

LIMITS = MissingLimits()
COLUMNS = np.broadcast_to(np.random.default_rng(1).choice([-0.025, 0.0, 0.0, 0.0, 0.0, 0.025], SHAPE[1]), SHAPE)
"""Metres: one column in three stands off by six standard deviations of the noise."""


def session(lose: Callable[[Float, np.random.Generator], Mask]) -> list[ViewEvidence]:
    """Quiet views, of which `lose(depth with columns, rng)` takes pixels (H, W)."""
    rng, out = np.random.default_rng(8), []
    for v in views(np.random.default_rng(5)):
        gone = lose(v.view.depth + COLUMNS, rng)
        depth, reason = np.where(gone, np.nan, v.view.depth), np.where(gone, Reason.NO_RETURN, Reason.VALID)
        seen = replace(v.view, depth=depth.astype(np.float32), reason=reason.astype(np.uint8), count=(~gone).astype(np.uint16))
        out.append(replace(v, view=seen, residual=np.where(gone, np.nan, v.residual), smooth=v.smooth & ~gone))
    return out


def beside(session: Sequence[ViewEvidence], pattern: Float) -> float:
    """Share of a session's pixels that are beside steps of a pattern (H, W)."""
    stepped = [v.stepped for v in beside_steps(session, [pattern] * len(session), LIMITS)]
    assert all(s is not None for s in stepped)
    return float(np.mean([s for s in stepped if s is not None]))


def edge_filter(depth: Float, rng: np.random.Generator) -> Mask:
    """Pixels whose row's neighbours span more than 55 mm: noise and the plane's slope do not, two columns against each other do."""
    del rng
    return np.asarray(maximum_filter(depth, (1, 3)) - minimum_filter(depth, (1, 3)) > 0.055)


def test_a_filter_s_loss_at_the_steps_of_a_pattern_is_no_dropout() -> None:
    lossy = session(edge_filter)
    assert np.mean([~v.view.valid for v in lossy]) > 0.03
    assert [f.name for f in missing_effects(lossy, LIMITS)] == ["dropout"], "without the pattern it looks like columns that are lost"
    assert missing_effects(beside_steps(lossy, [COLUMNS] * len(lossy), LIMITS), LIMITS) == []


@pytest.mark.parametrize("share", [0.05, 0.2])
def test_what_is_lost_at_random_beside_a_pattern_is_dropout_of_the_same_share(share: float) -> None:
    lossy = session(lambda depth, rng: edge_filter(depth, rng) | (rng.random(SHAPE) < share))
    (found,) = missing_effects(beside_steps(lossy, [COLUMNS] * len(lossy), LIMITS), LIMITS)
    assert isinstance(found.effect, Dropout)
    assert found.effect.random == pytest.approx(share, rel=0.05)


def test_at_most_half_of_the_pixels_are_beside_steps() -> None:
    rough = np.random.default_rng(2).normal(0, 0.05, SHAPE)
    assert beside(views(np.random.default_rng(5)), rough) == pytest.approx(0.5, abs=0.01)


@pytest.mark.parametrize(
    "pattern",
    [np.broadcast_to(np.linspace(-0.01, 0.01, SHAPE[1]), SHAPE), 0.2 * COLUMNS / 0.025 * SIGMA_M, np.full(SHAPE, np.nan)],
    ids=["smooth field", "columns within the noise", "no CAD"],
)
def test_a_pattern_that_stays_within_the_noise_has_no_steps(pattern: Float) -> None:
    assert beside(views(np.random.default_rng(5)), pattern) == 0.0


AVERAGING = NoiseCorrelation(lever=1.7, line=2.6, area=7.9, growth=2.3)
"""A camera that averages over 3 x 3 pixels."""


def in_lines(lossy: float, quiet: float) -> list[ViewEvidence]:
    """Views of an averaging camera in which three columns of four lose a share of their pixels, and the fourth another."""
    share = np.where(np.arange(SHAPE[1]) % 4 == 0, quiet, lossy)
    return [replace(v, correlation=AVERAGING) for v in session(lambda _, rng: rng.random(SHAPE) < share)]


def test_where_the_camera_averages_loss_by_lines_is_the_filter_s() -> None:
    faint = 0.1 * COLUMNS
    filtered = beside_steps(in_lines(0.08, 0.0), [faint] * VIEWS, LIMITS)
    assert missing_effects(filtered, LIMITS) == []
    assert np.mean([v.smooth for v in filtered]) == pytest.approx(0.25, abs=0.02), "noise is read off the quiet lines alone"


@pytest.mark.parametrize("share", [0.05, 0.2])
def test_where_the_camera_averages_loss_that_quiet_lines_share_is_dropout(share: float) -> None:
    (found,) = missing_effects(beside_steps(in_lines(share, 0.6 * share), [0.1 * COLUMNS] * VIEWS, LIMITS), LIMITS)
    assert isinstance(found.effect, Dropout)
    assert found.effect.random == pytest.approx(0.9 * share, rel=0.05)


def noisy_where(steep: Mask, factor: float) -> tuple[list[ViewEvidence], Float]:
    """Views of an averaging camera whose noise is `factor` times as large where a pattern of columns is steep, and that pattern (H, W)."""
    height = np.where(steep, 0.012, 0.001) * np.where(np.arange(SHAPE[1]) % 2, 1.0, -1.0)
    noise = np.where(steep, factor, 1.0)
    quiet = views(np.random.default_rng(5))
    return [replace(v, residual=v.residual * noise, correlation=AVERAGING) for v in quiet], np.broadcast_to(height, SHAPE)


STEEP = np.arange(SHAPE[1]) >= SHAPE[1] // 3
"""Two thirds of the columns are steep."""


def test_noise_that_grows_with_the_steps_of_a_pattern_is_read_off_where_the_pattern_is_smooth() -> None:
    noisy, pattern = noisy_where(STEEP, 1.6)
    judged = beside_steps(noisy, [pattern] * VIEWS, LIMITS)
    assert not any(v.smooth[:, STEEP].any() for v in judged)
    assert np.mean([v.smooth[:, ~STEEP].mean() for v in judged]) > 0.7
    assert all(v.noise_of_steps for v in judged)


def test_noise_that_does_not_follow_a_pattern_is_read_off_everywhere() -> None:
    noisy, pattern = noisy_where(STEEP, 1.0)
    judged = beside_steps(noisy, [pattern] * VIEWS, LIMITS)
    assert [v.smooth.sum() for v in judged] == [v.smooth.sum() for v in noisy]
    assert not any(v.noise_of_steps for v in judged)
