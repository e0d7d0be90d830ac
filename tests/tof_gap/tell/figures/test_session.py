# SPDX-License-Identifier: Apache-2.0
"""What the figures are made of: the pixels that count, mixed pixels, and noise that neighbours share."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from tests.tof_gap.quiet_views import CAMERA, SHAPE, views
from tof_gap.limits.report import ReportLimits
from tof_gap.seen.finding import Finding
from tof_gap.tell.figures.session import Figures, mixed_pixels, no_jumps, used
from tof_sensor.effects.flying_pixels import FlyingPixels
from tof_sensor.effects.noise import Noise
from tof_sensor.effects.phase_wrap import PhaseWrap

if TYPE_CHECKING:
    from tof_core.arrays import Float


def test_gross_pixels_and_edges_count_only_where_an_effect_explains_them() -> None:
    (view, *_) = views(np.random.default_rng(1))
    gross, edge, mixed = (np.zeros(SHAPE, bool) for _ in range(3))
    gross[10:12], edge[20:24], mixed[20:22] = True, True, True
    footprint = np.where(mixed, 0.3, np.where(edge, 0.45, 0.0)).astype(np.float32)
    frame = replace(view.frame, rendering=replace(view.rendering, mixed=footprint))
    seen = replace(view, frame=frame, gross=gross, edge=edge, smooth=view.smooth & ~gross & ~edge)
    counts = {
        name: np.isfinite(used(seen, f))
        for name, f in (
            ("", []),
            ("wrap", [Finding(PhaseWrap(), 1.0, corrects=True)]),
            ("filtered", [Finding(PhaseWrap(), 1.0)]),
            ("fly", [Finding(FlyingPixels(), 1.0, corrects=True)]),
        )
    }
    assert not counts[""][10:12].any()
    assert not counts[""][20:24].any()
    assert counts["wrap"][10:12].all()
    assert not counts["wrap"][20:24].any()
    assert not counts["filtered"][10:12].any(), "no map explains wrapped pixels that a filter removed"
    assert counts["fly"][20:22].all()
    assert not counts["fly"][22:24].any(), "half a pixel of pose decides which surface these see"


def test_gross_pixels_that_still_jump_once_effects_are_subtracted_are_left_out() -> None:
    view = views(np.random.default_rng(1))[0]
    gross, left = np.zeros(SHAPE, bool), np.zeros(SHAPE)
    gross[0, :2], left[0, :3] = True, (0.5, 0.001, 0.5)
    (kept,) = no_jumps([replace(view, gross=gross)], [left])
    assert np.isnan(kept[0, 0])
    np.testing.assert_array_equal(kept[0, 1:3], [0.001, 0.5])


def test_pixels_with_a_named_noise_of_their_own_are_in_no_figure() -> None:
    (view, *_) = views(np.random.default_rng(1))
    noisy = np.zeros(SHAPE, bool)
    noisy[5, 7] = noisy[9, 3] = True
    counted, all_of_them = (np.isfinite(used(view, [Finding(Noise(extra_m=0.002), 0.95, own_noise=n)])) for n in (noisy, None))
    np.testing.assert_array_equal(counted, all_of_them & ~noisy)


def of(residual: list[Float], **made: Any) -> Figures:
    """Figures of views with these residuals and 1 mm of noise, all held out."""
    blank, nowhere = [np.zeros(SHAPE)] * len(residual), [np.zeros(SHAPE, bool)] * len(residual)
    noise2 = [np.full(SHAPE, 0.001**2)] * len(residual)
    usual: dict[str, Any] = {
        "residual": residual,
        "floors": noise2,
        "maps": {},
        "common": blank,
        "noise2": noise2,
        "edge": nowhere,
        "gross": nowhere,
        "mixed": nowhere,
        "held": range(len(residual)),
        "unsure2": np.zeros(SHAPE),
        "step_m": 0.0,
        "posed_m": 0.0,
        "rng": np.random.default_rng(0),
        "limits": ReportLimits(),
    }
    return Figures(**(usual | made))


def test_what_neighbours_share_is_the_codes_step_and_half_of_named_shared_noise() -> None:
    figures = of([np.zeros(SHAPE)] * 2, common=[np.full(SHAPE, 0.004)] * 2, step_m=0.012, posed_m=0.003)
    assert figures.alike_m == pytest.approx(np.hypot(0.012 / np.sqrt(12), 0.5 * 0.005)), "what the poses took of it counts: 3 mm of 5"


def test_what_is_left_is_without_named_effects_and_shared_noise() -> None:
    residual, share, common = (np.full(SHAPE, v) for v in (0.010, 0.006, 0.001))
    figures = of([residual], maps={"wiggling": [share]}, common=[common])
    np.testing.assert_allclose(figures.left()[0], 0.003)
    np.testing.assert_allclose(figures.total(["wiggling"], 0), 0.006)
    np.testing.assert_allclose(figures.total([], 0), 0.0)
    assert CAMERA.shape == SHAPE


def test_a_mixed_pixel_between_its_surfaces_is_explained_whatever_its_share() -> None:
    """Mixed pixels of 50 mm whose map has the wrong share by half: both surfaces are in them, and that is what the effect says."""
    rng = np.random.default_rng(5)
    mixed = np.zeros(SHAPE, bool)
    mixed[:, ::16] = True
    residual = np.where(mixed, 0.05, 0.0) + rng.normal(0, 0.001, SHAPE)
    share = np.where(mixed, 0.025, 0.0)
    known, unknown = (
        of([residual], maps={"flying_pixels": [share]}, edge=[mixed], mixed=[between]).shrink(["flying_pixels"])
        for between in (mixed, np.zeros(SHAPE, bool))
    )
    assert known.shrink == pytest.approx(1.0, abs=0.02)
    assert unknown.shrink == pytest.approx(0.75, abs=0.02)


def test_where_edges_count_the_gap_away_from_them_is_stated_beside_it() -> None:
    """A wiggle of 4 mm everywhere and mixed pixels of 50 mm: the effect that explains the first takes off all away from edges."""
    mixed = np.zeros(SHAPE, bool)
    mixed[:, ::16] = True
    wave, jump = np.full(SHAPE, 0.004), np.where(mixed, 0.05, 0.0)
    residual = wave + jump + np.random.default_rng(5).normal(0, 0.001, SHAPE)
    figures = of([residual], maps={"wiggling": [wave], "flying_pixels": [jump]}, edge=[mixed], mixed=[mixed])
    alone = figures.shrink(["wiggling"])
    assert alone.off_edges_mm == pytest.approx((4.0, 0.0), abs=0.2)
    assert alone.off_edges == pytest.approx(1.0, abs=0.01)
    squares = 4.0**2 + (50.0**2 + 2 * 4.0 * 50.0) / 16, 50.0**2 / 16  # one pixel in 16 is at an edge
    assert alone.shrink == pytest.approx(1 - squares[1] / squares[0], abs=0.01), "these few make most of the gap"
    assert of([residual], maps={"wiggling": [wave]}, edge=[mixed]).shrink(["wiggling"]).off_edges_mm is None, "edges do not count"


def test_where_wrapped_pixels_count_the_gap_without_them_is_stated_beside_it() -> None:
    """A wiggle of 4 mm everywhere and one pixel in 64 wrapped by 2 m: the wrap makes nearly all of the squared error."""
    wrapped = np.zeros(SHAPE, bool)
    wrapped[::8, ::8] = True
    wave, wrap = np.full(SHAPE, 0.004), np.where(wrapped, 2.0, 0.0)
    residual = wave + wrap + np.random.default_rng(5).normal(0, 0.001, SHAPE)
    both = of([residual], maps={"wiggling": [wave], "phase_wrap": [wrap]}, gross=[wrapped]).shrink(["phase_wrap"])
    assert both.off_edges_mm == pytest.approx((4.0, 4.0), abs=0.1), "the wrap is no part of what most pixels are off by"
    assert both.shown_mm == both.off_edges_mm
    assert both.above_mm(both.before) == pytest.approx(2004 * np.sqrt(wrapped.mean()), rel=0.01)


def test_where_every_pixel_wraps_there_is_no_gap_without_them() -> None:
    wrap = np.full(SHAPE, 2.0)
    made = of([wrap], maps={"phase_wrap": [wrap]}, gross=[np.ones(SHAPE, bool)])
    assert made.shrink(["phase_wrap"]).off_edges_mm is None


def test_edges_that_measure_between_their_two_surfaces_or_wrap_are_mixed() -> None:
    (view, *_) = views(np.random.default_rng(1))
    middle = SHAPE[1] // 2
    depth = np.where(np.arange(SHAPE[1]) < middle, 1.0, 1.3) * np.ones(SHAPE)
    edge = np.zeros(SHAPE, bool)
    edge[:, middle] = True
    measured = depth.copy()
    measured[:10, middle], measured[10:20, middle], measured[20:, middle] = 1.15, 1.302, 1.31
    measured[-3:, middle] = 0.55, 2.8, 0.4
    sigma = np.full(SHAPE, 1e-3)
    seen = replace(view, frame=replace(view.frame, depth=depth), sigma=sigma, view=replace(view.view, depth=measured.astype(np.float32)))
    mixed = mixed_pixels(seen, edge)
    assert mixed[:10, middle].all(), "between both surfaces"
    assert mixed[10:20, middle].all(), "on the far one: two standard deviations of noise behind it"
    assert not mixed[20:-2].any(), "behind both, by ten of them; 0.45 m before both"
    assert mixed[-2:, middle].all(), "1.5 m behind both and 0.6 m before them: by wraps"
    assert mixed.sum() == 22, "no edge, no mixed pixel"
