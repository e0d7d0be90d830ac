# SPDX-License-Identifier: Apache-2.0
"""Stray light in a pulsed or coded camera: only surfaces up to its reach nearer or farther shift a pixel."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tests.tof_sensor.plane import CAMERA, plane_frame
from tof_sensor.effects.lens_scatter import WIDTHS, LensScatter, blurred
from tof_sensor.frame import ideal_frame

if TYPE_CHECKING:
    from tof_core.arrays import Float
    from tof_sensor.frame import Frame

LEFT = np.broadcast_to(np.arange(CAMERA.width) < CAMERA.width // 2, CAMERA.shape)
REACH_M = 0.9


def two_walls(apart_m: float) -> Frame:
    """A dark wall at 1 m on the left of the image, and a wall ten times as bright `apart_m` behind it on the right, along the rays."""
    amplitude = np.where(LEFT, 100.0, 1000.0)
    flat = plane_frame(amplitude=amplitude)
    along = np.where(LEFT, 1.0, 1.0 + apart_m) / flat.length
    return ideal_frame(replace(flat.rendering, depth=along.astype(np.float32)), None, amplitude)


def bias_on_the_dark_wall(effect: LensScatter, frame: Frame) -> Float:
    return np.asarray((effect.bias(frame) * frame.length)[LEFT])


def light_from_the_bright_wall(frame: Frame) -> Float:
    """Stray light of the whole image's width that reaches the pixels of the dark wall, over their own."""
    bright = np.where(LEFT, 0.0, frame.amplitude)
    (stray,) = blurred(bright[None], WIDTHS[-1] * CAMERA.width)
    return np.asarray(stray[LEFT] / frame.amplitude[LEFT])


@pytest.mark.parametrize("apart_m", [0.2, 0.5, 0.9])
def test_the_bias_is_the_difference_in_range_times_the_light_that_is_taken_in(apart_m: float) -> None:
    frame = two_walls(apart_m)
    expected = 0.01 * light_from_the_bright_wall(frame) * apart_m * np.exp(-((apart_m / REACH_M) ** 2))
    found = bias_on_the_dark_wall(LensScatter(veil=0.01, reach_m=REACH_M), frame)
    np.testing.assert_allclose(found, expected, rtol=0.35)
    assert np.corrcoef(found, expected)[0, 1] > 0.99


def test_light_of_surfaces_beyond_the_reach_shifts_nothing() -> None:
    far, near = two_walls(3.0), two_walls(0.6)
    of_pulse, of_wave = LensScatter(veil=0.01, reach_m=REACH_M), LensScatter(veil=0.01, modulation_mhz=10.0)
    assert np.abs(bias_on_the_dark_wall(of_pulse, far)).max() < 0.1 * np.abs(bias_on_the_dark_wall(of_pulse, near)).max()
    assert np.abs(bias_on_the_dark_wall(of_wave, far)).max() > 2.0 * np.abs(bias_on_the_dark_wall(of_wave, near)).max()


def test_a_view_of_one_range_has_no_bias() -> None:
    np.testing.assert_allclose(bias_on_the_dark_wall(LensScatter(veil=0.01, reach_m=REACH_M), two_walls(0.0)), 0.0, atol=1e-9)


def test_a_view_without_surfaces_has_no_bias() -> None:
    rendering = replace(two_walls(0.5).rendering, depth=np.full(CAMERA.shape, np.nan, np.float32))
    empty = ideal_frame(rendering, None, np.ones(CAMERA.shape))
    assert not LensScatter(veil=0.01, reach_m=REACH_M).bias(empty).any()


def test_chosen_pixels_have_the_rows_of_the_whole_image() -> None:
    frame, effect, some = two_walls(0.5), LensScatter(reach_m=REACH_M), np.array([5, 700, 1100])
    np.testing.assert_allclose(effect.columns_at(frame, some), effect.columns(frame).reshape(-1, 3)[some])
