# SPDX-License-Identifier: Apache-2.0
"""Corners of a board in an amplitude image."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from tof_core.board.spec import APRILTAG, CHECKER

if TYPE_CHECKING:
    from tof_core.arrays import Bytes, Float, Image
    from tof_core.board.spec import Board

LEAST_CORNERS = 8
"""Fewest corners for a pose: four determine it, the others show errors of single corners."""
REFINED_PX = 1.0
"""Pixels by which refinement may move a corner; beyond, it has moved to another edge."""


@dataclass(frozen=True, slots=True, eq=False)
class Corners:
    """Detected corners of a board: on_board (n, 3) metres in the board's frame; in_image (n, 2) pixels, integers at pixel centres."""

    on_board: Float
    in_image: Float


def find_corners(amplitude: Image, board: Board) -> Corners | None:
    """The board's corners in an amplitude image (H, W), None without a whole checkerboard, or `LEAST_CORNERS` of another board."""
    grey = grey_image(amplitude)
    if board.kind == CHECKER:
        return _checker(grey, board)
    found = _tags(grey, board) if board.kind == APRILTAG else _charuco(grey, board)
    return found if found is not None and len(found.on_board) >= LEAST_CORNERS else None


def grey_image(amplitude: Image) -> Bytes:
    """(H, W) uint8 of the square root of amplitude: near and far boards alike keep their contrast."""
    root = np.sqrt(np.maximum(np.nan_to_num(amplitude.astype(np.float64)), 0.0))
    bright = float(np.quantile(root, 0.995))
    return np.asarray(np.clip(255.0 * root / max(bright, 1e-12), 0, 255)).astype(np.uint8)


def _checker(grey: Bytes, board: Board) -> Corners | None:
    import cv2

    size = (board.columns, board.rows)
    flags = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_ACCURACY | cv2.CALIB_CB_EXHAUSTIVE
    seen, found = cv2.findChessboardCornersSB(grey, size, flags=flags)
    if not seen:
        seen, found = cv2.findChessboardCorners(grey, size, flags=cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE)
    if not seen:
        return None
    corners = found.reshape(board.rows, board.columns, 2).astype(np.float32)
    spacing = float(min(np.linalg.norm(np.diff(corners, axis=axis), axis=-1).min() for axis in (0, 1)))
    half = max(2, min(8, int(0.35 * spacing)))
    refined = cv2.cornerSubPix(grey, corners.reshape(-1, 1, 2).copy(), (half, half), (-1, -1), (3, 60, 1e-3)).reshape(corners.shape)
    near = np.linalg.norm(refined - corners, axis=-1, keepdims=True) < REFINED_PX
    ordered = _facing(np.where(near, refined, corners).astype(np.float64))
    return Corners(board.corners, ordered.reshape(-1, 2))


def _facing(corners: Float) -> Float:
    """Corners (rows, columns, 2), ordered so that the board's z axis points away from the camera: from row to column clockwise in the image."""
    along, down = corners[0, -1] - corners[0, 0], corners[-1, 0] - corners[0, 0]
    return corners if along[0] * down[1] - along[1] * down[0] > 0 else corners[:, ::-1]


def _charuco(grey: Bytes, board: Board) -> Corners | None:
    import cv2

    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_250)
    made = cv2.aruco.CharucoBoard((board.columns, board.rows), board.size_m, board.second_m, dictionary)
    found, ids, _, _ = cv2.aruco.CharucoDetector(made).detectBoard(grey)
    return None if ids is None else _matched(made, found, ids)


def _tags(grey: Bytes, board: Board) -> Corners | None:
    import cv2

    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    made = cv2.aruco.GridBoard((board.columns, board.rows), board.size_m, board.second_m, dictionary)
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    found, ids, _ = cv2.aruco.ArucoDetector(dictionary, parameters).detectMarkers(grey)
    return None if ids is None else _matched(made, found, ids)


def _matched(made: Any, found: Any, ids: Any) -> Corners:
    on_board, in_image = made.matchImagePoints(found, ids)
    if on_board is None:
        return Corners(np.zeros((0, 3)), np.zeros((0, 2)))
    return Corners(np.asarray(on_board, np.float64).reshape(-1, 3), np.asarray(in_image, np.float64).reshape(-1, 2))
