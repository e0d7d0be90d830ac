# SPDX-License-Identifier: Apache-2.0
"""Frames simulated from a sensor model: its bias, new noise, and measured depth at edges."""

from __future__ import annotations

import numpy as np
import pytest

from tests.tof_infer.made import CAMERA, measured, wall
from tof_infer.augment import Redraw
from tof_infer.samples import Sample
from tof_sensor.effects.photon_law import PhotonLaw
from tof_sensor.effects.range_offset import RangeOffset
from tof_sensor.effects.wiggling import Wiggling
from tof_sensor.model import SensorModel

RNG = np.random.default_rng(0)
INSIDE = np.s_[3:-3, 4:-4]


def sample(number: int = 1) -> Sample:
    capture, true = measured(number), wall(number)
    assert capture.amplitude is not None
    return Sample(
        capture.depth,
        capture.amplitude,
        30.0,
        true,
        np.zeros_like(true),
        np.ones(true.shape, bool),
        np.full_like(true, 0.2),
        np.full_like(true, np.nan),
    )


def test_the_bias_is_the_models() -> None:
    before = sample()
    drawn = Redraw(SensorModel((Wiggling(sine_m=0.004),)), CAMERA)(before, RNG)
    radial = before.label * CAMERA.ray_length()
    want = 0.004 * np.sin(2 * np.pi * radial / 0.3747405725) / CAMERA.ray_length()
    valid = np.isfinite(before.depth[INSIDE])
    np.testing.assert_allclose((drawn.depth - before.label)[INSIDE][valid], want[INSIDE][valid], atol=1e-6)


def test_noise_is_new_each_time_and_follows_the_photon_law() -> None:
    redraw = Redraw(SensorModel((PhotonLaw(floor_m=0.003, shot_m=0.0),)), CAMERA)
    one, other = redraw(sample(), RNG), redraw(sample(), RNG)
    assert not np.array_equal(one.depth, other.depth, equal_nan=True)
    assert np.nanstd((one.depth - one.label)[INSIDE]) == pytest.approx(0.003, rel=0.1)


@pytest.mark.parametrize("lost", [slice(None), INSIDE])
def test_without_amplitude_the_noise_is_that_of_the_reference_amplitude(lost: slice) -> None:
    dark = sample()
    dark.amplitude[lost] = np.nan
    reference = float(np.nanmedian(sample().amplitude))
    drawn = Redraw(SensorModel((PhotonLaw(floor_m=0.0, shot_m=0.003, reference=reference),)), CAMERA)(dark, RNG)
    assert np.nanstd((drawn.depth - drawn.label)[INSIDE]) == pytest.approx(0.003, rel=0.2)


def test_label_amplitude_and_lost_pixels_stay() -> None:
    before = sample()
    drawn = Redraw(SensorModel((RangeOffset(offset_m=0.01),)), CAMERA)(before, RNG)
    np.testing.assert_array_equal(drawn.label, before.label)
    np.testing.assert_array_equal(drawn.amplitude, before.amplitude)
    assert np.isnan(drawn.depth[2, 3])


def test_at_an_edge_the_measured_depth_is_kept() -> None:
    before = sample()
    before.label[:, 22:] += 0.3
    drawn = Redraw(SensorModel((RangeOffset(offset_m=0.01),)), CAMERA)(before, RNG)
    np.testing.assert_array_equal(drawn.depth[:, 21:23], before.depth[:, 21:23])
    assert np.nanmedian(drawn.depth[:, 5:15] - before.label[:, 5:15]) == pytest.approx(0.01 / 1.05, rel=0.1)
