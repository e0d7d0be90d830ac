# SPDX-License-Identifier: Apache-2.0
"""Cameras of CameraInfo messages: the same object for the same numbers, another one where any number differs."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from tof_core.cameras import MOST, Cameras
from tof_core.decode import camera_from_info
from tof_core.errors import CameraError


def info(**changes: Any) -> SimpleNamespace:
    roi = SimpleNamespace(x_offset=0, y_offset=0, width=0, height=0)
    values: dict[str, Any] = {
        "header": SimpleNamespace(frame_id="hand"),
        "width": 224,
        "height": 171,
        "distortion_model": "plumb_bob",
        "k": [212.4, 0.0, 115.3, 0.0, 212.4, 88.0, 0.0, 0.0, 1.0],
        "p": [200.0, 0.0, 115.0, 0.0, 0.0, 200.0, 88.0, 0.0, 0.0, 0.0, 1.0, 0.0],
        "d": [0.0] * 5,
        "binning_x": 0,
        "binning_y": 0,
        "roi": roi,
    }
    return SimpleNamespace(**{**values, **changes})


def test_the_same_numbers_give_the_same_camera_and_others_give_theirs() -> None:
    cameras = Cameras()
    one = cameras.of(info(), "camera_info", rectified=False)
    assert cameras.of(info(), "camera_info", rectified=False) is one
    changes: list[dict[str, Any]] = [
        {"header": SimpleNamespace(frame_id="arm")},
        {"width": 220},
        {"height": 170},
        {"distortion_model": "rational_polynomial", "d": [0.1] * 8},
        {"k": [212.5, 0.0, 115.3, 0.0, 212.4, 88.0, 0.0, 0.0, 1.0]},
        {"d": [0.1, 0.0, 0.0, 0.0, 0.0]},
        {"binning_x": 2},
        {"binning_y": 2},
        {"roi": SimpleNamespace(x_offset=4, y_offset=0, width=100, height=80)},
    ]
    for change in changes:
        other = cameras.of(info(**change), "camera_info", rectified=False)
        assert other == camera_from_info(info(**change))
        assert other != one
    assert cameras.of(info(), "camera_info", rectified=True) == camera_from_info(info(), rectified=True)
    assert cameras.of(info(), "camera_info", rectified=False) is one


def test_a_camera_that_changes_with_each_frame_is_read_each_time_and_stays_itself() -> None:
    cameras = Cameras()
    one = cameras.of(info(), "camera_info", rectified=False)
    for n in range(2 * MOST):
        assert cameras.of(info(width=100 + n), "camera_info", rectified=False).width == 100 + n
    assert cameras.of(info(), "camera_info", rectified=False) is one


def test_a_message_that_is_no_camera_is_refused_each_time() -> None:
    cameras = Cameras()
    for _ in range(2):
        with pytest.raises(CameraError, match="skew"):
            cameras.of(info(k=[212.4, 9.0, 115.3, 0.0, 212.4, 88.0, 0.0, 0.0, 1.0]), "camera_info", rectified=False)
