# SPDX-License-Identifier: Apache-2.0
"""Amplitude images of boards, drawn from the board's own pattern: what the tests of corners and poses look at."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tof_core import se3
from tof_core.camera import Camera

if TYPE_CHECKING:
    from tof_core.board.spec import Board

CAMERA = Camera(224, 172, 210.0, 210.0, 111.5, 85.5, "plumb_bob", (0.05, -0.1, 0.001, -0.001, 0.0))
OVERSAMPLED = 4


def pose(z: float, *, tilt: tuple[float, float, float] = (0.15, -0.25, 0.1), middle: tuple[float, float] = (0.06, 0.09)) -> np.ndarray:
    """T_board_camera of a camera before the middle of a board at z metres."""
    turn = se3.exp(np.array([0.0, 0.0, 0.0, *tilt]))
    turn[:3, 3] = np.array([0.0, 0.0, z]) - turn[:3, :3] @ np.array([*middle, 0.0])
    return np.asarray(se3.inverse(turn))


def draw(board: Board, T_board_camera: np.ndarray, camera: Camera = CAMERA, *, pattern: np.ndarray | None = None) -> np.ndarray:
    """(H, W) float32 amplitude, each pixel the mean over its area; `pattern` replaces the checker squares, over the board's extent."""
    steps = (np.arange(OVERSAMPLED) + 0.5) / OVERSAMPLED - 0.5
    v, u = np.mgrid[: camera.height, : camera.width].astype(float)
    out = np.zeros(camera.shape)
    for dv in steps:
        for du in steps:
            rays = camera.rays_at(np.stack([u + du, v + dv], axis=-1).reshape(-1, 2))
            direction, origin = rays @ T_board_camera[:3, :3].T, T_board_camera[:3, 3]
            x, y = (origin + direction * (-origin[2] / direction[:, 2])[:, None])[:, :2].T
            out += (_checker(board, x, y) if pattern is None else _picture(board, pattern, x, y)).reshape(out.shape)
    return np.asarray(3000.0 * out / OVERSAMPLED**2, np.float32)


def _checker(board: Board, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    column, row = np.floor(x / board.size_m) + 1, np.floor(y / board.size_m) + 1
    inside = (column >= 0) & (column <= board.columns) & (row >= 0) & (row <= board.rows)
    return np.where(inside, np.where((column + row) % 2 == 1, 0.8, 0.1), 0.8)


def _picture(board: Board, pattern: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    width, height = board.columns * board.size_m, board.rows * board.size_m
    if board.kind == "apriltag":
        width, height = board.extent
    column = np.floor(x / width * pattern.shape[1]).astype(int)
    row = np.floor(y / height * pattern.shape[0]).astype(int)
    inside = (column >= 0) & (column < pattern.shape[1]) & (row >= 0) & (row < pattern.shape[0])
    return np.where(
        inside, 0.1 + 0.7 * pattern[np.clip(row, 0, pattern.shape[0] - 1), np.clip(column, 0, pattern.shape[1] - 1)] / 255.0, 0.8
    )
