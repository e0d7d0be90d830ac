# SPDX-License-Identifier: Apache-2.0
"""Range, amplitude and the robot's own mask: which pixels are removed, and with which reason."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from PIL import Image as PillowImage

from tof_core.camera import Camera
from tof_core.errors import ConfigError
from tof_core.reasons import Reason
from tof_preproc.config import AmplitudeConfig, PreprocConfig, RangeConfig, SelfConfig
from tof_preproc.frame import Frame
from tof_preproc.stages import RASTER

if TYPE_CHECKING:
    from pathlib import Path

    from tof_core.arrays import Image

CAMERA = Camera(6, 5, 6.0, 6.0, 2.5, 2.0)


def frame_of(depth: Image, amplitude: Image | None = None) -> Frame:
    reason = np.where(np.isnan(depth), Reason.NO_RETURN, Reason.VALID).astype(np.uint8)
    return Frame(CAMERA, depth.copy(), reason, np.full(depth.shape, 1e-3, np.float32), amplitude)


def row(*depths: float) -> Image:
    return np.tile(np.array(depths, np.float32), (5, 1))


def test_range_keeps_its_bounds_and_what_lies_between() -> None:
    frame = frame_of(row(0.49, 0.5, 1.0, 2.0, 2.01, np.nan))
    assert RASTER["range"](frame, PreprocConfig(range=RangeConfig(low=0.5, high=2.0))) == 10
    np.testing.assert_array_equal(frame.reason[0], [Reason.OUT_OF_RANGE, 0, 0, 0, Reason.OUT_OF_RANGE, Reason.NO_RETURN])
    np.testing.assert_array_equal(np.isnan(frame.depth[0]), [1, 0, 0, 0, 1, 1])


def test_amplitude_out_of_bounds_or_unknown_is_removed() -> None:
    frame = frame_of(row(1, 1, 1, 1, 1, np.nan), row(9, 10, 50, 51, np.nan, 20))
    assert RASTER["amplitude"](frame, PreprocConfig(amplitude=AmplitudeConfig(low=10, high=50))) == 15
    gone = Reason.MASKED_AMPLITUDE
    np.testing.assert_array_equal(frame.reason[0], [gone, 0, 0, gone, gone, Reason.NO_RETURN])


@pytest.mark.parametrize("amplitude", [None, np.zeros((5, 6), np.float32)])
def test_amplitude_without_data_or_bounds_removes_nothing(amplitude: Image | None) -> None:
    config = PreprocConfig(amplitude=AmplitudeConfig(low=10.0 if amplitude is None else 0.0))
    assert RASTER["amplitude"](frame_of(row(*[1.0] * 6), amplitude), config) == 0


def test_the_robots_mask_takes_its_pixels_away(tmp_path: Path) -> None:
    mask = np.zeros((5, 6), np.uint8)
    mask[3:, 4:] = 255
    PillowImage.fromarray(mask).save(tmp_path / "gripper.png")
    frame = frame_of(row(*[1.0] * 6))
    assert RASTER["self"](frame, PreprocConfig(self_mask=SelfConfig(str(tmp_path / "gripper.png")))) == 4
    np.testing.assert_array_equal(frame.reason == Reason.SELF, mask > 0)


def test_a_mask_that_is_missing_or_of_another_camera_is_named(tmp_path: Path) -> None:
    PillowImage.new("L", (7, 5)).save(tmp_path / "other.png")
    for name, message in (("none.png", "cannot be read"), ("other.png", "is 7x5, the camera 6x5")):
        with pytest.raises(ConfigError, match=message):
            RASTER["self"](frame_of(row(*[1.0] * 6)), PreprocConfig(self_mask=SelfConfig(str(tmp_path / name))))


@given(arrays(np.float32, (5, 6), elements=st.one_of(st.just(np.nan), st.floats(0.125, 8.0, width=32))), st.sampled_from(sorted(RASTER)))
def test_no_stage_adds_or_moves_a_pixel(depth: Image, stage: str) -> None:
    frame = frame_of(depth, np.full(depth.shape, 7.0, np.float32))
    config = PreprocConfig(amplitude=AmplitudeConfig(low=5.0, high=6.0), range=RangeConfig(low=0.5, high=4.0))
    removed = RASTER[stage](frame, config)
    left = np.isfinite(frame.depth)
    assert not (left & np.isnan(depth)).any()
    np.testing.assert_array_equal(frame.depth[left], depth[left])
    np.testing.assert_array_equal(left, frame.reason == Reason.VALID)
    np.testing.assert_array_equal(frame.reason[np.isnan(depth)], Reason.NO_RETURN)
    assert removed == np.isfinite(depth).sum() - left.sum()
    if stage in ("range", "amplitude", "self"):
        assert RASTER[stage](frame, config) == 0  # idempotent; the others look at neighbours, which have changed
