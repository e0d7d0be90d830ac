# SPDX-License-Identifier: Apache-2.0
"""The camera's pose from a board's corners in the amplitude image, independent of measured depth."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from tof_core import se3

if TYPE_CHECKING:
    from tof_core.arrays import Float
    from tof_core.board.corners import Corners
    from tof_core.camera import Camera

LEAST_PX = 0.05
"""Least corner noise in pixels: that of OpenCV's refinement on sharp images."""
MOST_PX = 0.6
"""Pixels (RMS) of reprojection error beyond which the corners are not those of this board and lens."""


@dataclass(frozen=True, slots=True, eq=False)
class BoardPose:
    """T_board_camera (4, 4); cov (6, 6) of its right perturbation, metres and radians; rms_px: reprojection error."""

    T_board_camera: Float
    cov: Float
    rms_px: float

    @property
    def noise_px(self) -> float:
        """Standard deviation of a corner along one axis of the image."""
        return max(self.rms_px / float(np.sqrt(2.0)), LEAST_PX)


def board_pose(corners: Corners, camera: Camera) -> BoardPose | None:
    """The pose that projects the corners best (Levenberg-Marquardt on pixels), None where none does within `MOST_PX`."""
    T_camera_board, rms = best_pose(corners, camera)
    if rms > MOST_PX:
        return None
    seen = corners.on_board @ T_camera_board[:3, :3].T + T_camera_board[:3, 3]
    # A corner at p (camera frame) moves by -(v + w x p) under a right perturbation (v, w).
    J = pixel_jacobian(camera, seen)
    found = BoardPose(np.asarray(se3.inverse(T_camera_board)), np.asarray(np.linalg.inv(J.T @ J), float), rms)
    return replace(found, cov=found.noise_px**2 * found.cov)


def best_pose(corners: Corners, camera: Camera) -> tuple[Float, float]:
    """T_camera_board (4, 4) that projects the corners best, and the reprojection error, pixels RMS; infinite where no pose was found."""
    import cv2

    T, lens = np.eye(4), np.asarray(camera.distortion, float) if camera.distortion else None
    solved, rotation, translation = cv2.solvePnP(corners.on_board, corners.in_image, camera.K, lens)
    if not solved:
        return T, np.inf
    rotation, translation = cv2.solvePnPRefineLM(corners.on_board, corners.in_image, camera.K, lens, rotation, translation)
    T[:3, :3], T[:3, 3] = cv2.Rodrigues(rotation)[0], translation.ravel()
    left = camera.project(corners.on_board @ T[:3, :3].T + T[:3, 3]) - corners.in_image
    return T, float(np.sqrt((left**2).sum(axis=1).mean()))


def pixel_jacobian(camera: Camera, points: Float) -> Float:
    """(2n, 6) pixels of points (n, 3) in the camera's frame per right perturbation of the camera's pose, by central differences."""
    columns = []
    for k in range(6):
        step = np.zeros(6)
        step[k] = 1e-5
        moved = [points @ T[:3, :3].T + T[:3, 3] for T in (se3.inverse(se3.exp(step)), se3.exp(step))]
        columns.append((camera.project(moved[0]) - camera.project(moved[1])).ravel() / 2e-5)
    return np.stack(columns, axis=1)
