# SPDX-License-Identifier: Apache-2.0
"""A calibration board as a scene: its squares in two albedos, facing -z of the board's frame."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tof_scene.scene import Material, Part, Scene

if TYPE_CHECKING:
    from tof_core.arrays import Float
    from tof_core.board.spec import Board

FRAME = "board"
WHITE, BLACK = "white squares", "black squares"


def board_scene(board: Board, black: float, white: float, *, odd_is_black: bool = False) -> Scene:
    """The board's scene in the frame `board`.

    Args:
        board: squares and their size.
        black: albedo of the printed squares.
        white: albedo of the paper.
        odd_is_black: whether squares with an odd sum of column and row are the printed ones.
    """
    lower, odd = board.squares
    parts = [
        Part(name, *_quads(lower[which], board.extent), Material(albedo=albedo))
        for name, albedo, which in ((WHITE, white, (odd == 0) == odd_is_black), (BLACK, black, (odd == 1) == odd_is_black))
        if which.any()
    ]
    return Scene(FRAME, tuple(parts))


def _quads(lower: Float, extent: Float) -> tuple[Float, np.ndarray[tuple[int, ...], np.dtype[np.int32]]]:
    """Vertices and faces of rectangles in z = 0 whose normal is -z."""
    sides = np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * extent
    xy = (lower[:, None] + sides).reshape(-1, 2)
    first = 4 * np.arange(len(lower), dtype=np.int32)[:, None]
    faces = np.concatenate([first + np.array([0, 2, 1], np.int32), first + np.array([0, 3, 2], np.int32)])
    return np.concatenate([xy, np.zeros((len(xy), 1))], axis=1), faces.astype(np.int32)
