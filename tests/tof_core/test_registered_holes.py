# SPDX-License-Identifier: Apache-2.0
"""Depth registered to a camera of more pixels has a grid of holes, which no camera loses."""

from __future__ import annotations

import numpy as np
import pytest

from tof_core.registered import registered
from tof_core.registered_holes import holed, holes

H, W = 120, 156
ROW, COLUMN = np.mgrid[:H, :W]


def grid(period: float = 12.5) -> np.ndarray:
    """(H, W) pixels that no point falls on, one line in `period` pixels; columns shift with the depth of a slope."""
    at_row, at_column = ((np.floor(x / period) != np.floor((x - 1) / period)) for x in (ROW, COLUMN + ROW / 40.0))
    return np.asarray(at_row | at_column)


def test_a_grid_of_lines_is_registered_depth_and_all_of_it_is_holes() -> None:
    lost = grid()
    assert holed([~lost] * 3) == pytest.approx(lost.mean(), rel=0.15), "crossings and the image's border apart"
    depth = np.where(lost, np.nan, 1.0 + np.random.default_rng(1).normal(0, 0.003, lost.shape))
    assert registered([depth], "/hand/depth").endswith(f"{100 * holed([~lost]):.0f} % of the pixels are holes in lines one pixel wide")
    inner = np.s_[2:-2, 2:-2]
    assert np.mean(holes(~lost)[inner][lost[inner]]) > 0.97, "crossings included"
    assert not holes(~lost)[~lost].any()


def test_lines_of_one_direction_pixels_at_random_and_patches_are_the_cameras_own_loss() -> None:
    rows = np.asarray(ROW % 12 == 0)
    scattered = np.random.default_rng(2).random((H, W)) < 0.15
    patch = (np.abs(ROW - 60) < 20) & (np.abs(COLUMN - 70) < 30)
    for lost in (rows, scattered, patch):
        assert holed([~lost]) == 0.0
    assert registered([np.where(scattered, np.nan, 1.0003)], "/hand/depth") == ""


def test_single_lost_pixels_beside_the_grid_are_lost_by_the_camera() -> None:
    alone = (ROW == 6) & (COLUMN == 6)
    assert not holes(~(grid() | alone))[6, 6]


def test_without_an_image_there_is_no_grid() -> None:
    assert holed([]) == 0.0
