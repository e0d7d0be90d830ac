# SPDX-License-Identifier: Apache-2.0
"""Depth that a driver has registered to another camera is worth knowing, and the depth camera's own image is named instead."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tof_core.camera import Camera
from tof_core.options import BagOptions
from tof_core.topics import Topics
from toftwin.doctor.finding import Level
from toftwin.doctor.frames import examine_frames

CAMERA = Camera(width=80, height=60, fx=70.0, fy=70.0, cx=39.5, cy=29.5)


def message(depth: np.ndarray) -> Any:
    """An Image of depth in metres."""
    return SimpleNamespace(
        height=depth.shape[0], width=depth.shape[1], encoding="32FC1", is_bigendian=0, step=4 * depth.shape[1], data=depth.tobytes()
    )


def notes(depth: np.ndarray, topic: str) -> list[str]:
    """What is worth knowing about three frames."""
    found = examine_frames([message(depth)] * 3, Topics(depth=topic), CAMERA, BagOptions(depth="radial"))
    return [f.line() for f in found if f.level is Level.NOTE]


def noisy(shape: tuple[int, int]) -> np.ndarray:
    """A wall with noise."""
    return (1.0 + np.random.default_rng(1).normal(0.0, 0.003, shape)).astype(np.float32)


@pytest.mark.parametrize(
    ("depth", "topic"),
    [
        (noisy(CAMERA.shape), "/camera/aligned_depth_to_color/image_raw"),
        (np.repeat(np.repeat(noisy((30, 40)), 2, axis=0), 2, axis=1), "/depth/hand/image"),
    ],
)
def test_registered_depth_is_a_note_that_says_what_to_record(depth: np.ndarray, topic: str) -> None:
    (line,) = notes(depth, topic)
    assert "registered to another camera" in line
    assert "record the depth camera's own image" in line


def test_copies_of_depth_in_whole_millimetres_are_known_by_the_amplitude_of_the_same_stamp() -> None:
    coded = np.rint(1e3 * np.repeat(np.repeat(noisy((30, 40)), 2, axis=0), 2, axis=1)).astype(np.uint16)
    light = np.repeat(np.repeat(np.random.default_rng(2).integers(500, 4000, (30, 40)), 2, axis=0), 2, axis=1).astype(np.uint16)

    def of(image: np.ndarray, encoding: str, second: int) -> Any:
        header = SimpleNamespace(stamp=SimpleNamespace(sec=second, nanosec=0))
        height, width = image.shape
        return SimpleNamespace(
            header=header, height=height, width=width, encoding=encoding, is_bigendian=0, step=2 * width, data=image.tobytes()
        )

    def noted(second: int) -> list[str]:
        topics = Topics(depth="/depth/hand/image", amplitude="/depth/hand/amplitude")
        lights = [of(light, "mono16", second)]
        found = examine_frames([of(coded, "16UC1", 7)], topics, CAMERA, BagOptions(depth="radial"), lights)
        return [f.line() for f in found if f.level is Level.NOTE]

    torn = SimpleNamespace(**vars(of(light, "mono16", 7)) | {"encoding": "bgr8", "step": 6 * CAMERA.width})
    found = list(examine_frames([of(coded, "16UC1", 7)], Topics(depth="/d", amplitude="/a"), CAMERA, BagOptions(depth="radial"), [torn]))
    assert [f.check for f in found if f.level is Level.FIX] == ["amplitude"], "depth is examined all the same"
    assert "depth" in {f.check for f in found}
    (line,) = noted(7)
    assert "of neighbouring pixels are copies of each other" in line
    assert noted(8) == []


def test_the_camera_s_own_depth_is_no_note() -> None:
    assert notes(noisy(CAMERA.shape), "/depth/hand/image") == []
