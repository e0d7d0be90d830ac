# SPDX-License-Identifier: Apache-2.0
"""Where the cell is placed: what the text says, and what a pose drawn on a map moves."""

from __future__ import annotations

import numpy as np
import pytest

from tof_core import se3
from tof_core.errors import UsageError
from tof_core.placement import is_planar, moved_in_plane, parse_placement


def test_the_frame_stands_before_a_colon_and_is_the_camera_without_one() -> None:
    placed = parse_placement("spot/odom: 1, 2, 0.5")
    assert placed is not None
    assert placed.frame == "spot/odom"
    assert placed.T_frame_cell[:3, 3].tolist() == [1, 2, 0.5]
    camera = parse_placement("0 0 0.8 0 0 0 1", "lens")
    assert camera is not None
    assert camera.frame == "lens"
    assert parse_placement(" ") is None


def test_an_invalid_pose_is_refused_with_the_name_of_the_parameter() -> None:
    with pytest.raises(UsageError, match=r"live.initial_pose: '1 2' is not 'x y z qx qy qz qw'"):
        parse_placement("1 2", where="live.initial_pose")


def test_a_pose_that_is_drawn_on_a_map_moves_place_and_heading_and_keeps_height_and_tilt() -> None:
    before = se3.from_quat((1.0, 2.0, 0.7), se3.quat_from_matrix(se3.exp([0, 0, 0, 0.1, -0.2, 0.5])[:3, :3]))
    drawn = se3.from_quat((3.0, -1.0, 0.0), (0.0, 0.0, np.sin(0.6), np.cos(0.6)))
    assert is_planar(drawn)
    assert not is_planar(before)
    after = moved_in_plane(drawn, before)
    assert after[:3, 3].tolist() == [3.0, -1.0, 0.7]
    assert np.arctan2(after[1, 0], after[0, 0]) == pytest.approx(1.2)
    np.testing.assert_allclose(after[2, :3], before[2, :3], atol=1e-12)
