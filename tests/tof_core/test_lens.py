# SPDX-License-Identifier: Apache-2.0
"""A lens off the stated one: the camera that has it, and how its rays turn."""

from __future__ import annotations

import numpy as np
import pytest

from tof_core.camera import Camera
from tof_core.lens import LENS, apart_px, ray_shift, with_lens

STATED = Camera(64, 48, 60.0, 61.0, 31.2, 24.1, "plumb_bob", (0.05, -0.01, 1e-3, 0.0, 0.0))
SMALL = np.array([1e-4, 1e-4, 1e-2, 1e-2, 1e-4, 1e-4, 1e-5, 1e-5])


def test_each_parameter_is_the_difference_to_the_stated_value() -> None:
    camera = with_lens(STATED, np.array([0.01, -0.02, 1.5, -0.5, 0.1, 0.2, 3e-3, 4e-3]))
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == pytest.approx((60.6, 59.78, 32.7, 23.6))
    assert camera.distortion == pytest.approx((0.15, 0.19, 4e-3, 4e-3, 0.0))
    assert with_lens(STATED, np.zeros(8)) == STATED


@pytest.mark.parametrize("k", range(len(LENS)), ids=LENS)
def test_rays_turn_by_each_parameter_as_the_shift_says(k: int) -> None:
    step = np.zeros(8)
    step[k] = SMALL[k]
    turned = (with_lens(STATED, step).rays() - with_lens(STATED, -step).rays())[..., :2] / (2 * SMALL[k])
    shift = ray_shift(STATED.rays(), STATED)[..., k]
    # The stated distortion bends the rays a little besides: a few per cent of the shift.
    np.testing.assert_allclose(shift, turned, atol=0.12 * np.abs(turned).max())


def test_lenses_are_apart_by_their_largest_difference_in_pixels() -> None:
    shifted = with_lens(Camera(64, 48, 60.0, 60.0, 31.5, 23.5), np.array([0, 0, 2.0, 0, 0, 0, 0, 0]))
    assert apart_px(Camera(64, 48, 60.0, 60.0, 31.5, 23.5), shifted) == pytest.approx(2.0)
    assert apart_px(STATED, STATED) == 0.0
