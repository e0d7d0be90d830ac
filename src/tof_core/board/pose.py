# SPDX-License-Identifier: Apache-2.0
"""The camera's pose from a board's corners: it owes nothing to the phase."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from tof_core import se3
from tof_core.errors import RefusedError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Float
    from tof_core.board.corners import Corners
    from tof_core.camera import Camera

LEAST_PX = 0.05
"""Pixels of corner noise that are assumed at least: what OpenCV's refinement reaches on sharp images."""
MOST_PX = 0.6
"""Pixels (RMS) of reprojection error beyond which the corners are not those of this board and lens."""


@dataclass(frozen=True, slots=True, eq=False)
class BoardPose:
    """T_board_camera (4, 4); cov (6, 6) of its right perturbation, metres and radians; rms_px: what the reprojection leaves."""

    T_board_camera: Float
    cov: Float
    rms_px: float


def board_pose(corners: Corners, camera: Camera) -> BoardPose | None:
    """The pose that projects the corners best (Levenberg-Marquardt on pixels), None where none does within `MOST_PX`."""
    import cv2

    lens = np.asarray(camera.distortion, float) if camera.distortion else None
    solved, rotation, translation = cv2.solvePnP(corners.on_board, corners.in_image, camera.K, lens)
    if not solved:
        return None
    rotation, translation = cv2.solvePnPRefineLM(corners.on_board, corners.in_image, camera.K, lens, rotation, translation)
    T_camera_board = np.eye(4)
    T_camera_board[:3, :3], T_camera_board[:3, 3] = cv2.Rodrigues(rotation)[0], translation.ravel()
    seen = corners.on_board @ T_camera_board[:3, :3].T + T_camera_board[:3, 3]
    left = camera.project(seen) - corners.in_image
    rms = float(np.sqrt((left**2).sum(axis=1).mean()))
    if rms > MOST_PX:
        return None
    # Each of x and y errs by rms / sqrt 2; a corner at p (camera frame) moves by -(v + w x p) under a right perturbation (v, w).
    noise = max(rms / np.sqrt(2.0), LEAST_PX)
    J = _pixel_jacobian(camera, seen)
    return BoardPose(np.asarray(se3.inverse(T_camera_board)), noise**2 * np.linalg.inv(J.T @ J), rms)


def _pixel_jacobian(camera: Camera, points: Float) -> Float:
    """(2n, 6) pixels per right perturbation of the camera's pose, by central differences."""
    columns = []
    for k in range(6):
        step = np.zeros(6)
        step[k] = 1e-5
        moved = [points @ T[:3, :3].T + T[:3, 3] for T in (se3.inverse(se3.exp(step)), se3.exp(step))]
        columns.append((camera.project(moved[0]) - camera.project(moved[1])).ravel() / 2e-5)
    return np.stack(columns, axis=1)


def calibrated(camera: Camera, seen: Sequence[Corners]) -> tuple[Camera, Float, float]:
    """The camera with focal lengths, centre and five distortion coefficients fitted to boards.

    Returns:
        the camera, (9,) standard deviations of (fx, fy, cx, cy, k1, k2, p1, p2, k3), RMS reprojection error in pixels.

    Raises:
        RefusedError: fewer than six boards.
    """
    import cv2

    if len(seen) < LEAST_BOARDS:
        raise RefusedError(
            f"{len(seen)} boards are too few to calibrate a lens", where="--calibrate", todo=f"record at least {LEAST_BOARDS} poses"
        )
    on_board = [c.on_board.astype(np.float32) for c in seen]
    in_image = [c.in_image.astype(np.float32) for c in seen]
    start = np.zeros(5)
    start[: min(5, len(camera.distortion))] = camera.distortion[:5]
    rms, K, lens, _, _, std, _, _ = cv2.calibrateCameraExtended(
        on_board, in_image, (camera.width, camera.height), camera.K.copy(), start, flags=cv2.CALIB_USE_INTRINSIC_GUESS
    )
    fitted = replace(
        camera,
        fx=float(K[0, 0]),
        fy=float(K[1, 1]),
        cx=float(K[0, 2]),
        cy=float(K[1, 2]),
        distortion_model="plumb_bob",
        distortion=tuple(float(x) for x in lens.ravel()[:5]),
    )
    return fitted, np.asarray(std, float).ravel()[:9], float(rms)


LEAST_BOARDS = 6
"""Boards that a lens calibration needs: nine coefficients, and poses that differ in tilt."""
