# SPDX-License-Identifier: Apache-2.0
"""What is computed once per frame."""

from __future__ import annotations

import gc
from functools import partial

import numpy as np

from tests.tof_sensor.plane import plane_frame
from tof_sensor.frame import Frame, once_per_frame


def test_a_value_of_chosen_pixels_is_computed_once_and_that_of_a_whole_image_each_time() -> None:
    calls = []

    @once_per_frame
    def pixels(frame: Frame) -> int:
        calls.append(frame.depth.size)
        return frame.depth.size

    whole = plane_frame()
    few = whole.take(np.arange(5))
    assert [pixels(f) for f in (few, few, whole, whole)] == [5, 5, 1200, 1200]
    assert calls == [5, 1200, 1200]


def test_a_value_of_a_whole_image_is_kept_where_asked_and_dies_with_the_frame() -> None:
    calls = []

    @partial(once_per_frame, whole=True)
    def counted(frame: Frame) -> int:
        calls.append(frame.depth.size)
        return len(calls)

    frame = plane_frame()
    assert (counted(frame), counted(frame)) == (1, 1)
    del frame
    gc.collect()
    assert counted(plane_frame()) == 2
