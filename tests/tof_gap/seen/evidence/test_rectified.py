# SPDX-License-Identifier: Apache-2.0
"""A driver that rectifies by the nearest pixel shifts the rays of all views alike."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tests.tof_gap.quiet_views import CAMERA, SHAPE, VIEWS, views
from tof_gap.seen.evidence.rectified import added_depth, ray_shift, rounded_mm

if TYPE_CHECKING:
    from tof_gap.seen.evidence.view import ViewEvidence

NOISE_M = 0.001


def rounded() -> np.ndarray:
    """(H, W, 2) pixels to the nearest one of a sensor behind a barrel lens."""
    x, y = CAMERA.rays()[..., 0], CAMERA.rays()[..., 1]
    place = 1.03 * CAMERA.fx * np.stack([x, y], axis=-1) * (1.0 - 0.2 * (x * x + y * y))[..., None] + 0.3
    return np.asarray(np.round(place) - place)


def seen(shift: np.ndarray) -> tuple[ViewEvidence, ...]:
    """Views of a tilted plane with 1 mm of noise, through rays off by `shift` pixels."""
    rng = np.random.default_rng(4)
    bare = views(np.random.default_rng(2), photons=False)
    extra = np.stack([added_depth(v.frame, shift) * v.frame.length for v in bare]) + rng.normal(0, NOISE_M, (VIEWS, *SHAPE))
    return views(np.random.default_rng(2), extra, photons=False)


def test_rounding_is_found_and_taken_off_the_depth() -> None:
    true = rounded()
    evidence = seen(true)
    found = ray_shift(evidence)
    assert found is not None
    errors = [(added_depth(v.frame, true), added_depth(v.frame, true - found)) for v in evidence]
    before, after = (float(np.sqrt(np.mean([np.square(e[k]) for e in errors]))) for k in (0, 1))
    assert before > 0.8e-3
    assert after < 0.5 * before


def test_a_camera_without_it_has_no_shift() -> None:
    assert ray_shift(seen(0.0 * rounded())) is None


def test_a_smooth_shift_of_another_lens_is_no_rounding() -> None:
    x, y = CAMERA.rays()[..., 0], CAMERA.rays()[..., 1]
    assert ray_shift(seen(np.stack([0.5 + x, 0.5 - y], axis=-1))) is None


def test_a_fixed_pattern_is_no_rounding_although_it_resembles_one_on_like_slants() -> None:
    offset = 0.004 * np.repeat(np.random.default_rng(5).normal(size=(SHAPE[0], SHAPE[1] // 4 + 1)), 4, axis=1)[:, : SHAPE[1]]
    extra = offset + np.random.default_rng(4).normal(0, NOISE_M, (VIEWS, *SHAPE))
    assert ray_shift(views(np.random.default_rng(2), extra, photons=False)) is None


def test_a_camera_with_distortion_publishes_its_own_image_and_few_views_show_nothing() -> None:
    evidence = seen(rounded())
    bent = replace(CAMERA, distortion=(-0.2, 0.0, 0.0, 0.0, 0.0))
    assert ray_shift([replace(v, view=replace(v.view, camera=bent)) for v in evidence]) is None
    assert ray_shift(evidence[:7]) is None


def test_the_size_of_the_rounding_is_that_of_the_depth_that_it_moves() -> None:
    evidence = seen(0.0 * rounded())
    assert rounded_mm(evidence) is None
    shifted = [replace(v, view=replace(v.view, ray_shift=rounded())) for v in evidence]
    size_m = np.sqrt(np.mean([np.mean(added_depth(v.frame, rounded())[v.smooth] ** 2) for v in evidence]))
    assert rounded_mm(shifted) == pytest.approx(1e3 * size_m)
