# SPDX-License-Identifier: Apache-2.0
"""A board as a scene: squares in the right places, facing the camera."""

from __future__ import annotations

import numpy as np
import pytest

from tof_core.board.spec import Board
from tof_scene.board import BLACK, WHITE, board_scene
from tof_scene.raycast import Raycaster


@pytest.mark.parametrize("odd_is_black", [False, True])
def test_squares_alternate_and_face_the_camera(*, odd_is_black: bool) -> None:
    scene = board_scene(Board.parse("5x7x0.030"), 0.1, 0.8, odd_is_black=odd_is_black)
    first = np.array([-0.015, -0.015])  # column 0, row 0: even
    xy = first + 0.03 * np.array([[0, 0], [1, 0], [0, 1], [1, 1], [5, 7]])
    origin = np.concatenate([xy, np.full((5, 1), -0.5)], axis=1)
    hits = Raycaster(scene).cast(origin, np.tile([0.0, 0.0, 1.0], (5, 1)))
    np.testing.assert_allclose(hits.t, 0.5, atol=1e-6)
    np.testing.assert_allclose(hits.normal, np.tile([0.0, 0.0, -1.0], (5, 1)), atol=1e-6)
    even, odd = (WHITE, BLACK) if odd_is_black else (BLACK, WHITE)
    assert [scene.names[p] for p in hits.part] == [even, odd, odd, even, even]
    assert scene.part(WHITE).material.albedo == 0.8


def test_the_board_ends_where_its_squares_end() -> None:
    scene = board_scene(Board.parse("5x7x0.030"), 0.1, 0.8)
    np.testing.assert_allclose(scene.bounds(), [[-0.03, -0.03, 0.0], [0.15, 0.21, 0.0]], atol=1e-12)
    tags = board_scene(Board.parse("apriltag:4x6x0.040x0.010"), 0.1, 0.8)
    np.testing.assert_allclose(tags.bounds(), [[0.0, 0.0, 0.0], [0.19, 0.29, 0.0]], atol=1e-12)
