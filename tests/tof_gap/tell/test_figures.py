# SPDX-License-Identifier: Apache-2.0
"""What the figures are made of: the pixels that count, the floor under them, and noise that neighbours share."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.tof_gap.quiet_views import CAMERA, SHAPE, views
from tof_gap.limits.report import ReportLimits
from tof_gap.seen.finding import Finding
from tof_gap.tell.figures import Figures, floor2, used
from tof_sensor.effects.flying_pixels import FlyingPixels
from tof_sensor.effects.noise import Noise
from tof_sensor.effects.phase_wrap import PhaseWrap
from tof_sensor.geometry import pose_columns


def test_the_floor_is_noise_and_pose_posterior() -> None:
    (view, *_) = views(np.random.default_rng(1))
    along = np.zeros((6, 6))
    along[2, 2] = 0.002**2
    (only_noise,), (both,) = floor2([view], np.zeros((1, 6, 6))), floor2([view], along[None])
    np.testing.assert_allclose(only_noise, view.sigma**2)
    # A step along the optical axis changes depth by itself, and by the slope of the surface.
    np.testing.assert_allclose(both - only_noise, 0.002**2 * pose_columns(view.frame)[..., 2] ** 2)
    assert np.sqrt((both - only_noise)[SHAPE[0] // 2, SHAPE[1] // 2]) == pytest.approx(0.002, rel=0.3)


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


def test_pixels_with_a_named_noise_of_their_own_are_in_no_figure() -> None:
    (view, *_) = views(np.random.default_rng(1))
    noisy = np.zeros(SHAPE, bool)
    noisy[5, 7] = noisy[9, 3] = True
    counted, all_of_them = (np.isfinite(used(view, [Finding(Noise(extra_m=0.002), 0.95, own_noise=n)])) for n in (noisy, None))
    np.testing.assert_array_equal(counted, all_of_them & ~noisy)


def test_what_neighbours_share_is_the_codes_step_and_half_of_named_shared_noise() -> None:
    common = [np.full(SHAPE, 0.004)] * 2
    figures = Figures([], [], {}, common, [], (), np.zeros(SHAPE), 0.012, 0.003, np.random.default_rng(0), ReportLimits())
    assert figures.alike_m == pytest.approx(np.hypot(0.012 / np.sqrt(12), 0.5 * 0.005)), "what the poses took of it counts: 3 mm of 5"


def test_what_is_left_is_without_named_effects_and_shared_noise() -> None:
    residual, share, common = (np.full(SHAPE, v) for v in (0.010, 0.006, 0.001))
    figures = Figures(
        [residual], [], {"wiggling": [share]}, [common], [], (), np.zeros(SHAPE), 0.0, 0.0, np.random.default_rng(0), ReportLimits()
    )
    np.testing.assert_allclose(figures.left()[0], 0.003)
    np.testing.assert_allclose(figures.total(["wiggling"], 0), 0.006)
    np.testing.assert_allclose(figures.total([], 0), 0.0)
    assert CAMERA.shape == SHAPE
