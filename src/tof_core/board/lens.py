# SPDX-License-Identifier: Apache-2.0
"""The lens from a board's corners: whether the stated lens fits, a lens fitted to the corners, and the effect of lens errors on poses."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from tof_core import se3
from tof_core.board.pose import best_pose, pixel_jacobian
from tof_core.errors import RefusedError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Float
    from tof_core.board.corners import Corners
    from tof_core.board.pose import BoardPose
    from tof_core.camera import Camera

LENS_SHARE = 0.1
"""Share of the squared reprojection error that a fitted lens must remove for the stated lens to be wrong. With the lens right (calibrated with
other boards), a fit to half the frames of a session removes 1 to 5 %; with its distortion missing, 18 to 27 %."""
USUAL_SD = (3.0, 3.0, 0.05, 0.1, 1e-3, 1e-3)
"""Prior standard deviations of (cx, cy, k1, k2, p1, p2), pixels and ratios: spread between two calibrations of one lens."""
STEPS = (0.5, 0.5, 1e-3, 1e-3, 1e-4, 1e-4)
"""Steps in (cx, cy, k1, k2, p1, p2) for central differences: about a tenth of a pixel in the image, far above rounding."""


@dataclass(frozen=True, slots=True, eq=False)
class LensFault:
    """A stated lens that does not fit the corners, and the fitted lens.

    stated, camera: with the stated and with the fitted lens; std (9,): standard deviations of the fitted (fx, fy, cx, cy, k1, k2, p1, p2, k3),
    0 where the stated value was kept; stated_px, fitted_px: reprojection error with either lens, RMS over all corners.
    """

    stated: Camera
    camera: Camera
    std: Float
    stated_px: float
    fitted_px: float


def lens_fault(camera: Camera, seen: Sequence[Corners]) -> LensFault | None:
    """The fitted lens where the corners contradict the stated one; None where they agree with it or are too few.

    The distortion alone is fitted where that explains the corners: boards at one distance hardly determine the focal length.
    """
    if len(seen) < LEAST_BOARDS:
        return None
    stated = _rms_px(camera, seen)
    fits = [calibrated(camera, seen, distortion_alone=alone) for alone in (True, False)]
    left = [_rms_px(fitted, seen) for fitted, _, _ in fits]
    if min(left) ** 2 > (1.0 - LENS_SHARE) * stated**2:
        return None
    which = int(left[1] ** 2 < (1.0 - LENS_SHARE) * left[0] ** 2)
    return LensFault(camera, fits[which][0], fits[which][1], stated, left[which])


def _rms_px(camera: Camera, seen: Sequence[Corners]) -> float:
    return float(np.sqrt(np.mean([best_pose(c, camera)[1] ** 2 for c in seen])))


def calibrated(camera: Camera, seen: Sequence[Corners], *, distortion_alone: bool = False) -> tuple[Camera, Float, float]:
    """The camera with focal lengths, centre and five distortion coefficients fitted to boards; with `distortion_alone` k1, k2, p1 and p2.

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
    kept = cv2.CALIB_FIX_FOCAL_LENGTH | cv2.CALIB_FIX_PRINCIPAL_POINT | cv2.CALIB_FIX_K3 if distortion_alone else 0
    rms, K, lens, _, _, std, _, _ = cv2.calibrateCameraExtended(
        on_board, in_image, (camera.width, camera.height), camera.K.copy(), start, flags=cv2.CALIB_USE_INTRINSIC_GUESS | kept
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


def with_lens_errors(poses: Sequence[BoardPose], seen: Sequence[Corners], camera: Camera) -> list[BoardPose]:
    """The poses with the covariance of lens errors added, as far as all corners together leave principal point and distortion open.

    A principal point that is off by two pixels tilts a board by 0.3 degrees and hardly shifts its corners, so the corner noise alone
    understates the error of the tilt. A lens error moves rays and pose together: added is the pose error that changes the board's
    depth as much with the stated rays. The focal length is left out: its error scales all distances alike, as a print scale does.
    """
    info, noise2 = np.diag(np.asarray(USUAL_SD) ** -2.0), float(np.mean([p.noise_px**2 for p in poses]))
    shifts = []
    for pose, corners in zip(poses, seen, strict=True):
        T = se3.inverse(pose.T_board_camera)
        points = corners.on_board @ T[:3, :3].T + T[:3, 3]
        by_pose, by_lens = pixel_jacobian(camera, points), _lens_jacobian(camera, points)
        move = -np.linalg.lstsq(by_pose, by_lens, rcond=None)[0]
        unmoved = by_lens + by_pose @ move
        info += unmoved.T @ unmoved / noise2
        shifts.append(_same_depth(points, T[:3, 2]) @ move)
    lens = np.linalg.inv(info)
    return [replace(p, cov=p.cov + shift @ lens @ shift.T) for p, shift in zip(poses, shifts, strict=True)]


def _same_depth(points: Float, normal: Float) -> Float:
    """(6, 6) map of a pose step that moves rays and corners together to the smallest step with fixed rays that changes depth as much.

    A corner at p moves by -(v + w x p) under a step (v, w); along a fixed ray r the depth of the plane changes by -(n.v + (p x n).w) / n.r.
    """
    along_rays = np.concatenate([np.tile(normal, (len(points), 1)), np.cross(points, normal)], axis=1)
    along_rays /= (points / points[:, 2:] @ normal)[:, None]
    axis = np.array([0.0, 0.0, 1.0])
    with_corners = np.concatenate([np.tile(axis, (len(points), 1)), np.cross(points, axis)], axis=1)
    return np.asarray(np.linalg.pinv(along_rays, rcond=1e-6) @ with_corners)


def _lens_jacobian(camera: Camera, points: Float) -> Float:
    """(2n, 6) pixels of points (n, 3) in the camera's frame per cx, cy, k1, k2, p1, p2, by central differences."""
    return np.stack(
        [((_turned(camera, k, h).project(points) - _turned(camera, k, -h).project(points)) / (2 * h)).ravel() for k, h in enumerate(STEPS)],
        axis=1,
    )


def _turned(camera: Camera, which: int, step: float) -> Camera:
    """The camera with one of cx, cy, k1, k2, p1, p2 changed."""
    if which < 2:
        return replace(camera, cx=camera.cx + step) if which == 0 else replace(camera, cy=camera.cy + step)
    distortion = [*camera.distortion, *np.zeros(max(5 - len(camera.distortion), 0))]
    distortion[which - 2] += step
    return replace(camera, distortion_model=camera.distortion_model if camera.distortion else "plumb_bob", distortion=tuple(distortion))
