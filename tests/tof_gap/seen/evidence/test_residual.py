# SPDX-License-Identifier: Apache-2.0
"""Which pixels count: what lies near edges, what a moving camera smears, and what stands out in thin marks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.tof_gap.quiet_views import CAMERA, SHAPE, VIEWS, rendering, views
from tof_gap.limits.evidence import BlurLimits, EvidenceLimits
from tof_gap.seen.evidence.edges import edge_band, excluded, smear, streaks
from tof_gap.seen.evidence.residual import compact, gather, with_codes, without_geometry
from tof_sensor.frame import Context, Frame, ideal_frame

LIMITS, BLUR = EvidenceLimits(), BlurLimits()
SLIDES = np.array([0.15, 0, 0, 0, 0, 0])
"""0.15 m/s along the image's rows: 17 pixels a second at 0.9 m."""


def frame(twist: np.ndarray | None = None, *, step_m: float = 0.0, fold: bool = False) -> Frame:
    """A tilted plane; its right half `step_m` farther, or as dark as if it were folded away."""
    r = rendering(0.0)
    depth, incidence = r.depth.copy(), r.incidence.copy()
    depth[:, SHAPE[1] // 2 :] += np.float32(step_m)
    if fold:
        incidence[:, SHAPE[1] // 2 :] = np.float32(1.2)
    made = replace(r, depth=depth, incidence=incidence)
    return ideal_frame(made, Context(twist=np.zeros(6) if twist is None else twist))


def columns(mask: np.ndarray) -> tuple[int, int]:
    """First and last column that a mask holds in the middle row."""
    where = np.flatnonzero(mask[SHAPE[0] // 2])
    return (int(where[0]), int(where[-1])) if len(where) else (-1, -1)


def given_up(f: Frame, wider: int = 0) -> np.ndarray:
    """What a band of two pixels, grown by the view's own smear, takes."""
    return excluded(f, LIMITS, wider, smear(f, BLUR))


def test_a_still_view_gives_up_the_band_around_a_step_and_no_more() -> None:
    middle = SHAPE[1] // 2
    assert smear(frame(step_m=0.3), BLUR) == 0
    assert columns(given_up(frame(step_m=0.3))) == (middle - 3, middle + 2)
    assert columns(given_up(frame(step_m=0.3), wider=1)) == (middle - 4, middle + 3)
    assert not given_up(frame(fold=True)).any()


def test_a_moving_view_gives_up_what_the_image_flows_and_folds_too() -> None:
    moved = frame(SLIDES, step_m=0.3)
    flow = 0.15 * CAMERA.fx / 0.9
    assert smear(moved, BLUR) == pytest.approx(min(0.2 * flow, 0.04 * SHAPE[1]), abs=1)
    still, moving = (columns(given_up(f)) for f in (frame(step_m=0.3), moved))
    assert still[0] - moving[0] == moving[1] - still[1] == smear(moved, BLUR)
    assert columns(given_up(frame(SLIDES, fold=True))) == moving
    assert not edge_band(frame(fold=True), 2, LIMITS).any()


def test_a_hand_whose_pose_trembles_stands() -> None:
    assert smear(frame(SLIDES / 100), BLUR) == 0
    assert smear(frame(SLIDES / 10), BLUR) == 1


def test_a_thin_mark_is_left_out_and_a_wide_one_stays() -> None:
    rng = np.random.default_rng(2)
    residual = rng.normal(0, 1e-3, SHAPE)
    residual[40:42, 20:80] += 0.02
    residual[60:, :] += 0.02
    out = streaks(residual, np.full(SHAPE, 1e-3), np.ones(SHAPE, bool), BLUR)
    assert out[40:42, 22:78].mean() > 0.95
    assert out[65:, :].mean() < 0.01
    assert out[:35, :].mean() < 0.01


def test_what_scatters_far_is_not_gross_and_what_lost_a_turn_is() -> None:
    rng = np.random.default_rng(4)
    turned = np.zeros((VIEWS, *SHAPE))
    turned[:, 30:60, 30:60] = 0.9
    noisy = views(rng, 0.03 * rng.standard_normal(turned.shape) + turned)
    beyond = np.stack([np.abs(v.residual) > 0.06 for v in noisy])
    lost = np.stack([v.gross for v in noisy])
    assert beyond[turned == 0].mean() > 0.03
    assert lost[turned == 0].mean() < 1e-4
    assert lost[turned > 0].mean() > 0.999


def test_where_every_other_pixel_lost_a_turn_that_is_no_scatter() -> None:
    rng = np.random.default_rng(4)
    turned = np.zeros((VIEWS, *SHAPE))
    turned[:, 20:, :] = 0.9 * rng.integers(0, 2, turned[:, 20:, :].shape)
    seen = views(rng, turned)
    assert np.stack([v.gross for v in seen])[turned > 0].all()
    assert max(float(v.sigma.max()) for v in seen) < 0.02


@pytest.mark.parametrize(
    ("measured", "counted"),
    [(0.1, 0.0), (0.5, 1.0)],
    ids=["a tenth is left", "half is left"],
)
def test_survivors_of_a_failure_do_not_count_and_what_is_lost_by_half_does(measured: float, counted: float) -> None:
    rng = np.random.default_rng(4)
    lost = np.zeros((VIEWS, *SHAPE), bool)
    lost[:, 40:, :] = rng.random((VIEWS, SHAPE[0] - 40, SHAPE[1])) > measured
    seen = views(rng, np.where(lost, np.nan, 0.0))
    inner = np.stack([v.smooth for v in seen])[:, 46:-6, 6:-6]
    assert inner[~lost[:, 46:-6, 6:-6]].mean() == pytest.approx(counted, abs=0.02)
    assert np.stack([v.smooth for v in seen])[:, 6:34, 6:-6].all()


@pytest.mark.parametrize(("captures_left", "counted"), [(1, 0.0), (3, 1.0)])
def test_the_mean_of_a_dwell_does_not_hide_what_most_captures_lose(captures_left: int, counted: float) -> None:
    """Of five captures of the lower rows each pixel has so many: all have a mean."""
    made = views(np.random.default_rng(4))
    lower = np.zeros(SHAPE, bool)
    lower[40:] = True
    of_five = [replace(v.view, captures=5, count=np.where(lower, captures_left, 5).astype(np.uint16)) for v in made]
    seen = gather(of_five, [v.rendering for v in made], None, EvidenceLimits())  # type: ignore[arg-type]
    assert np.stack([v.smooth for v in seen])[:, 46:-6, 6:-6].mean() == pytest.approx(counted, abs=0.02)
    assert np.stack([v.smooth for v in seen])[:, 6:34, 6:-6].all()


def test_a_coarse_step_is_seen_through_another_lens_and_bounds_the_noise() -> None:
    """A lens turns codes of 8 mm into continuous z; neighbours that were rounded alike still know their depth to a code only."""
    step, ratio = 0.008, (1.0 + 1e-3 * np.arange(SHAPE[1]) / SHAPE[1]).astype(np.float32)
    (one, *_) = views(np.random.default_rng(2))
    recorded = replace(one.view, depth=(step * np.round(one.rendering.depth / step)).astype(np.float32))
    (coded,) = with_codes([recorded], EvidenceLimits().level)
    for given, expected in ((recorded, 0.0), (coded, step)):
        turned = replace(given, depth=given.depth / ratio)
        (seen,) = gather([turned], [one.rendering], None, EvidenceLimits(edge_px=0))  # type: ignore[arg-type]
        assert seen.step_m == pytest.approx(expected, abs=1e-5)
        assert seen.sigma.min() >= 0.99 * expected / np.sqrt(12)


def test_what_is_kept_of_a_view_is_of_single_precision_and_depth_is_the_renderings_own() -> None:
    view = views(np.random.default_rng(0))[0]
    kept = view.frame
    assert {str(image.dtype) for image in (view.residual, view.sigma, kept.amplitude)} == {"float32"}
    assert np.shares_memory(kept.depth, kept.rendering.depth)
    assert kept.sigma.strides == kept.missing.strides == view.concavity.strides == (0, 0)
    ideal = ideal_frame(kept.rendering)
    np.testing.assert_allclose(kept.radial, ideal.radial, rtol=1e-12)


def test_without_geometry_residual_noise_and_masks_stay() -> None:
    view = views(np.random.default_rng(0))[0]
    bare = without_geometry(view)
    assert bare.residual is view.residual
    assert bare.edge is view.edge
    images = (bare.frame.depth, bare.frame.amplitude, bare.concavity, bare.rendering.depth, bare.rendering.incidence)
    assert {image.strides for image in images} == {(0, 0)}
    assert bare.rendering.normal.strides == (0, 0, 0)
    np.testing.assert_array_equal(bare.frame.length, view.frame.length)
    np.testing.assert_array_equal(bare.rendering.T_cell_camera, view.rendering.T_cell_camera)


def test_a_second_surface_is_kept_only_where_a_pixel_has_one() -> None:
    frame = views(np.random.default_rng(0))[0].frame
    blank = np.zeros(frame.depth.shape, np.float32)
    mixed = blank.copy()
    mixed[2, 3] = 0.25
    one, two = (compact(replace(frame, rendering=replace(frame.rendering, mixed=m, second=blank + 1))).rendering for m in (blank, mixed))
    assert one.mixed.strides == one.second.strides == (0, 0)
    assert np.isnan(one.second).all()
    assert two.mixed is mixed
    assert (two.second == 1).all()
