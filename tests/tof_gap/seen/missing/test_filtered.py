# SPDX-License-Identifier: Apache-2.0
"""Holes of a filter in the camera: unwrapping that fails in weak light, against thresholds, single pixels and noise."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from scipy.ndimage import binary_dilation
from scipy.stats import mannwhitneyu

from tests.tof_gap.quiet_views import SHAPE, views
from tof_core.reasons import Reason
from tof_gap.limits.missing import MissingLimits
from tof_gap.seen.missing.effects import missing_effects
from tof_gap.seen.missing.filtered import chance_dimmer, failed_unwrapping, filtered, removed_for_noise
from tof_gap.seen.missing.lost import expected
from tof_sensor.effects.dropout import Dropout
from tof_sensor.effects.phase_wrap import SINGLE_PIXELS, PhaseWrap
from tof_sensor.frame import lambert_amplitude

if TYPE_CHECKING:
    from collections.abc import Callable

    from tof_core.arrays import Float, Mask
    from tof_gap.seen.evidence.view import ViewEvidence

LIMITS = MissingLimits()
BLOCK = np.ones((3, 3), bool)


def session(
    lose: Callable[[Float, np.random.Generator], Mask], *, sigma: float = 1.0, amplitude: bool = True, uneven: float = 0.0
) -> list[ViewEvidence]:
    """Quiet views with `sigma` times their noise, of which `lose(light relative to the session's mean, rng)` takes pixels (H, W).

    uneven: standard deviation of the light from pixel to pixel, over it; the amplitude image shows it.
    """
    rng, out, quiet = np.random.default_rng(8), [], views(np.random.default_rng(5))
    mean = np.mean([lambert_amplitude(v.rendering).mean() for v in quiet])
    for v in quiet:
        light = (lambert_amplitude(v.rendering) / mean * (1.0 + uneven * rng.standard_normal(SHAPE))).astype(np.float32)
        gone = lose(light, rng)
        depth, reason = np.where(gone, np.nan, v.view.depth), np.where(gone, Reason.NO_RETURN, Reason.VALID)
        seen = replace(v.view, depth=depth.astype(np.float32), reason=reason.astype(np.uint8), amplitude=light if amplitude else None)
        residual = np.where(gone, np.nan, v.residual * sigma)
        out.append(replace(v, view=seen, residual=residual, sigma=v.sigma * sigma, smooth=v.smooth & ~gone))
    return out


def outliers_in_weak_light(light: Float, rng: np.random.Generator) -> Mask:
    """Outliers whose rate falls with light; the filter takes each with its neighbours."""
    return np.asarray(binary_dilation(rng.random(SHAPE) < 0.2 * np.exp(-8.0 * (light - 0.5)), BLOCK))


def single_outliers(light: Float, rng: np.random.Generator) -> Mask:
    """The same outliers, each removed by itself."""
    return np.asarray(rng.random(SHAPE) < 0.2 * np.exp(-8.0 * (light - 0.5)))


def names(session: list[ViewEvidence], left_out: frozenset[str] = frozenset()) -> list[str]:
    return [f.name for f in missing_effects(session, LIMITS, left_out)]


def test_holes_of_a_filter_in_weak_light_are_failed_unwrapping() -> None:
    (found,) = missing_effects(session(outliers_in_weak_light), LIMITS)
    assert isinstance(found.effect, PhaseWrap)
    assert 0 < found.effect.share < SINGLE_PIXELS
    assert found.effect.makes_outliers
    assert found.structure, "an effect without a name may make outliers, too"
    assert not found.corrects  # The filter left no pixel that is off by a period.
    assert "filter" in found.note


def test_single_pixels_that_a_check_removed_in_weak_light_are_failed_unwrapping() -> None:
    lossy = session(single_outliers)
    (found,) = missing_effects(lossy, LIMITS)
    assert isinstance(found.effect, PhaseWrap)
    assert "one by one in weak light" in found.size
    assert all(np.array_equal(h, ~v.view.valid & expected(v, LIMITS)) for h, v in zip(found.holes, lossy, strict=True))
    assert found.effect.share == pytest.approx(np.mean([(~v.view.valid)[expected(v, LIMITS)].mean() for v in lossy]), rel=0.2)


@pytest.mark.parametrize(
    ("rate", "effect", "words"), [(8.0, PhaseWrap, "in some captures of a dwell and not in others"), (0.0, Dropout, "")]
)
def test_other_pixels_that_each_capture_loses_in_weak_light_are_failed_unwrapping(rate: float, effect: type, words: str) -> None:
    """Four captures a dwell; the filter takes each outlier with its neighbours. At any light (rate 0), the same loss is at random."""
    rng, seen = np.random.default_rng(3), []
    for v in session(lambda _, rng: rng.random(SHAPE) < 0.0):
        light = np.asarray(v.view.amplitude)
        chance = 0.05 * np.exp(-rate * (light - 0.5)) if rate else np.full(SHAPE, 0.02)
        count = sum((~binary_dilation(rng.random(SHAPE) < chance, BLOCK)).astype(int) for _ in range(4))
        depth, reason = np.where(count > 0, v.view.depth, np.nan), np.where(count > 0, Reason.VALID, Reason.NO_RETURN)
        view = replace(v.view, captures=4, count=count, depth=depth.astype(np.float32), reason=reason.astype(np.uint8))
        seen.append(replace(v, view=view, residual=np.where(count > 0, v.residual, np.nan), smooth=v.smooth & (count > 0)))
    (found,) = missing_effects(seen, LIMITS)
    assert isinstance(found.effect, effect)
    assert words in found.size


def test_single_pixels_below_a_threshold_in_uneven_light_are_dropout() -> None:
    """Holes at the threshold are of single pixels here and there, and their rims as dim as it."""
    assert names(session(lambda light, _: light < 0.7, uneven=0.1)) == ["dropout"]


def test_loss_below_a_threshold_of_amplitude_is_dropout() -> None:
    lossy = session(lambda light, rng: light * (1 + 0.02 * rng.standard_normal(SHAPE)) < 0.7)
    assert names(lossy) == ["dropout"]
    assert not any(f.any() for f in filtered(lossy, LIMITS).gone)


@pytest.mark.parametrize("outline_px", [0, 2])
def test_a_foreign_object_that_was_taken_out_is_no_hole_and_its_outline_is_an_edge(outline_px: int) -> None:
    """An object over dark pixels, and the outline that the camera's edge filter removes around it."""
    lossy = session(lambda _, rng: rng.random(SHAPE) < 0.0)
    of = np.zeros(SHAPE, bool)
    of[8:38, 8:38] = True
    removed = binary_dilation(of, BLOCK, iterations=outline_px) if outline_px else of
    reason = np.where(of, Reason.NOT_CAD, np.where(removed, Reason.NO_RETURN, Reason.VALID)).astype(np.uint8)
    seen = [replace(v, view=replace(v.view, depth=np.where(removed, np.float32(np.nan), v.view.depth), reason=reason)) for v in lossy]
    assert names(seen) == []
    assert not any(f.any() for f in filtered(seen, LIMITS).gone)


def test_single_pixels_lost_at_random_are_dropout() -> None:
    assert names(session(lambda _, rng: rng.random(SHAPE) < 0.05)) == ["dropout"]


@pytest.mark.parametrize(("share", "sigma", "by_design"), [(0.03, 5.0, True), (0.03, 1.0, False), (0.1, 5.0, False)])
def test_a_few_pixels_lost_at_random_in_much_noise_are_a_filter_s_outliers(share: float, sigma: float, *, by_design: bool) -> None:
    (found,) = missing_effects(session(lambda _, rng: rng.random(SHAPE) < share, sigma=sigma), LIMITS)
    assert isinstance(found.effect, Dropout)
    assert found.expected == by_design
    assert bool(found.by_design) == by_design


def test_outliers_at_any_light_are_neither_failed_unwrapping_nor_dropout() -> None:
    assert names(session(lambda _, rng: binary_dilation(rng.random(SHAPE) < 0.01, BLOCK))) == []


def test_large_holes_at_any_light_are_dropout() -> None:
    assert names(session(lambda _, rng: binary_dilation(rng.random(SHAPE) < 0.002, np.ones((7, 7), bool)))) == ["dropout"]


def test_noise_that_reaches_what_a_filter_lets_pass_is_no_failed_unwrapping() -> None:
    assert names(session(outliers_in_weak_light, sigma=5.0)) == []


@pytest.mark.parametrize(("sigma", "removed"), [(1.0, False), (5.0, True)])
def test_what_a_filter_removes_for_noise_is_known(sigma: float, *, removed: bool) -> None:
    """Five times the noise reaches what the filter lets pass; at its usual noise the same holes are around outliers."""
    lossy = session(outliers_in_weak_light, sigma=sigma)
    holes = removed_for_noise(lossy, LIMITS)
    assert any(h.any() for h in holes) == removed
    assert not removed or all(np.array_equal(h, f) for h, f in zip(holes, filtered(lossy, LIMITS).gone, strict=True))


def test_the_filter_sees_the_noise_of_single_captures() -> None:
    """Nine captures leave a third of their noise in the mean: it is not the mean's that the filter's limit stops."""
    of_nine = [replace(v, view=replace(v.view, captures=9)) for v in session(outliers_in_weak_light, sigma=2.0)]
    assert names(session(outliers_in_weak_light, sigma=2.0)) == ["phase_wrap"]
    assert failed_unwrapping(of_nine, filtered(of_nine, LIMITS), LIMITS) is None


def test_a_step_that_the_filter_hides_is_not_stated_in_metres() -> None:
    (found,) = missing_effects(session(outliers_in_weak_light), LIMITS)
    assert "step that is not seen" in found.size


def test_a_filter_s_holes_are_no_dropout_where_phase_wrap_is_left_out() -> None:
    assert names(session(outliers_in_weak_light), frozenset({"phase_wrap"})) == []


def test_without_amplitude_no_hole_is_a_filter_s() -> None:
    assert not any(f.any() for f in filtered(session(outliers_in_weak_light, amplitude=False), LIMITS).gone)


def test_the_chance_that_lost_pixels_are_dimmer_is_that_of_their_ranks() -> None:
    rng = np.random.default_rng(2)
    seen = views(np.random.default_rng(5))[:3]
    light = [lambert_amplitude(v.rendering) for v in seen]
    inside = [rng.random(SHAPE) < 0.8 for _ in seen]
    gone = [i & (rng.random(SHAPE) < 0.3 / (1 + a)) for i, a in zip(inside, light, strict=True)]
    every, lost = (
        np.concatenate([a[i] for a, i in zip(light, inside, strict=True)]),
        np.concatenate([g[i] for g, i in zip(gone, inside, strict=True)]),
    )
    expected = mannwhitneyu(every[~lost], every[lost]).statistic / (lost.sum() * (~lost).sum())
    assert chance_dimmer(seen, inside, gone) == pytest.approx(expected, rel=1e-12)
    assert chance_dimmer(seen, inside, [np.zeros(SHAPE, bool)] * 3) == 0.5, "none is lost"
    assert chance_dimmer(seen, inside, inside) == 0.5, "each is lost"
