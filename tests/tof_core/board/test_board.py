# SPDX-License-Identifier: Apache-2.0
"""Boards in amplitude images: corners where they are, poses with honest covariances, lenses fitted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.tof_core.board.drawn import CAMERA, draw, pose
from tof_core import se3
from tof_core.board.corners import Corners, find_corners
from tof_core.board.lens import calibrated, lens_fault, with_lens_errors
from tof_core.board.pose import board_pose
from tof_core.board.spec import Board
from tof_core.errors import RefusedError, UsageError

CHECKER = Board.parse("5x7x0.030")


@pytest.mark.parametrize(
    ("text", "kind", "size", "second"),
    [
        ("5x7x0.030", "checker", 0.03, 0.0),
        ("checker:5x7x.03", "checker", 0.03, 0.0),
        ("charuco:6x8x0.030x0.022", "charuco", 0.03, 0.022),
        ("apriltag:4x6x0.040x0.010", "apriltag", 0.04, 0.01),
    ],
)
def test_a_board_is_read_from_its_text(text: str, kind: str, size: float, second: float) -> None:
    board = Board.parse(text)
    assert (board.kind, board.size_m, board.second_m) == (kind, size, second)


@pytest.mark.parametrize(
    "text", ["", "5x7", "5x7x30", "1x7x0.03", "charuco:6x8x0.03", "charuco:6x8x0.03x0.04", "dots:5x7x0.03", "5x7x0.03x0.02"]
)
def test_an_invalid_board_is_refused_with_the_valid_forms(text: str) -> None:
    with pytest.raises(UsageError, match=r"5x7x0\.030"):
        Board.parse(text)


def test_squares_of_a_checkerboard_surround_its_inner_corners() -> None:
    lower, odd = CHECKER.squares
    assert len(lower) == 6 * 8
    np.testing.assert_allclose(lower.min(axis=0), -0.03)
    np.testing.assert_allclose((lower + CHECKER.extent).max(axis=0), [0.15, 0.21])
    assert odd.sum() == 24


@pytest.mark.parametrize("z", [0.45, 0.6])
def test_corners_and_pose_of_a_checkerboard(z: float) -> None:
    T = pose(z)
    corners = find_corners(draw(CHECKER, T), CHECKER)
    assert corners is not None
    seen = (CHECKER.corners - T[:3, 3]) @ T[:3, :3]
    off = corners.in_image - CAMERA.project(seen)
    turned = corners.in_image[::-1] - CAMERA.project(seen)  # an odd by odd board looks the same turned half round
    assert min(float(np.abs(off).max()), float(np.abs(turned).max())) < 0.2
    assert float(np.abs(min((off, turned), key=lambda o: float(np.abs(o).mean())).mean())) < 0.03
    found = board_pose(corners, CAMERA)
    assert found is not None
    assert found.rms_px < 0.15
    # The plane's distance along the axis owes nothing to which way round the board is.
    assert _axis_distance(found.T_board_camera) == pytest.approx(_axis_distance(T), abs=1.5e-3)
    assert found.T_board_camera[2, 3] < 0  # the printed side faces -z
    assert (np.linalg.eigvalsh(found.cov) > 0).all()


def _axis_distance(T_board_camera: np.ndarray) -> float:
    """Metres along the optical axis from the camera to the board's plane."""
    return float(-T_board_camera[2, 3] / T_board_camera[2, 2])


def test_the_covariance_of_the_pose_holds_the_error() -> None:
    """Chi-square of six over noisy corners: within its 99 % band, from both sides."""
    rng = np.random.default_rng(1)
    T, noise, rounds = pose(0.5), 0.2, 60
    seen = CAMERA.project((CHECKER.corners - T[:3, 3]) @ T[:3, :3])
    total = 0.0
    for _ in range(rounds):
        corners = replace(find_like(CHECKER), in_image=seen + rng.normal(0, noise, seen.shape))
        found = board_pose(corners, CAMERA)
        assert found is not None
        error = se3.log(se3.inverse(T) @ found.T_board_camera)
        total += float(error @ np.linalg.solve(found.cov, error))
    mean, spread = 6.0 * rounds, np.sqrt(12.0 * rounds)
    assert mean - 2.6 * spread < total < mean + 4.0 * spread  # the noise itself is estimated from 64 degrees of freedom


def find_like(board: Board) -> Corners:
    """Corners of a board at no place in particular."""
    return Corners(board.corners, np.zeros((len(board.corners), 2)))


def test_a_board_that_is_not_there_is_not_found() -> None:
    assert find_corners(np.full(CAMERA.shape, 900.0, np.float32), CHECKER) is None
    assert find_corners(np.full(CAMERA.shape, np.nan, np.float32), CHECKER) is None


def test_corners_of_another_board_give_no_pose() -> None:
    rng = np.random.default_rng(0)
    corners = replace(find_like(CHECKER), in_image=rng.uniform(20, 150, (35, 2)))
    assert board_pose(corners, CAMERA) is None


@pytest.mark.parametrize("text", ["charuco:6x8x0.030x0.022", "apriltag:4x5x0.040x0.010"])
def test_boards_of_markers(text: str) -> None:
    cv2 = pytest.importorskip("cv2")
    board = Board.parse(text)
    if board.kind == "charuco":
        made = cv2.aruco.CharucoBoard((6, 8), 0.03, 0.022, cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_250))
        picture, middle = made.generateImage((600, 800)), (0.09, 0.12)
    else:
        made = cv2.aruco.GridBoard((4, 5), 0.04, 0.01, cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11))
        picture, middle = made.generateImage((760, 960)), (0.095, 0.12)
    camera = replace(CAMERA, width=448, height=344, fx=420.0, fy=420.0, cx=223.5, cy=171.5)
    T = pose(0.45, middle=middle)
    corners = find_corners(draw(board, T, camera, pattern=picture), board)
    assert corners is not None
    found = board_pose(corners, camera)
    assert found is not None
    assert _axis_distance(found.T_board_camera) == pytest.approx(_axis_distance(T), abs=3e-3)


def test_the_lens_is_fitted_to_boards_and_says_how_well() -> None:
    rng = np.random.default_rng(2)
    true = replace(CAMERA, fx=214.0, cx=113.0)
    seen = []
    for _ in range(12):
        T = pose(float(rng.uniform(0.3, 0.6)), tilt=tuple(rng.uniform(-0.5, 0.5, 3)))
        at = true.project((CHECKER.corners - T[:3, 3]) @ T[:3, :3])
        seen.append(replace(find_like(CHECKER), in_image=at + rng.normal(0, 0.05, at.shape)))
    fitted, std, rms = calibrated(CAMERA, seen)
    assert abs(fitted.fx - true.fx) < 4 * std[0] < 4.0
    assert abs(fitted.cx - true.cx) < 4 * std[2]
    assert rms == pytest.approx(0.05 * np.sqrt(2), rel=0.15)
    with pytest.raises(RefusedError, match="too few to calibrate"):
        calibrated(CAMERA, seen[:3])


def test_what_an_error_of_the_principal_point_does_to_depth_is_within_the_poses_covariance() -> None:
    T = pose(0.5, tilt=(0.2, -0.3, 0.1))
    true = (CHECKER.corners - T[:3, 3]) @ T[:3, :3]
    corners = replace(find_like(CHECKER), in_image=replace(CAMERA, cx=CAMERA.cx + 2.0).project(true))
    found = board_pose(corners, CAMERA)
    assert found is not None
    (sure,) = with_lens_errors([found], [corners], CAMERA)
    # Depth of the board along the stated rays, as found and per step of the pose.
    there = se3.inverse(found.T_board_camera)
    column, row = np.rint(corners.in_image).astype(int).T
    rays, normal = CAMERA.rays()[row, column], there[:3, 2]
    depth = there[:3, 3] @ normal / (rays @ normal)
    steps = -np.concatenate([np.tile(normal, (35, 1)), np.cross(depth[:, None] * rays, normal)], axis=1) / (rays @ normal)[:, None]
    seen = T[:3, :3].T @ [0.0, 0.0, 1.0]
    true_rays = replace(CAMERA, cx=CAMERA.cx + 2.0).rays()[row, column]
    error = -(T[:3, 3] @ [0.0, 0.0, 1.0]) / (true_rays @ seen) - depth
    of_corners, with_lens = (np.sqrt(np.einsum("ni,ij,nj->n", steps, p.cov, steps)) for p in (found, sure))
    assert np.sqrt(np.mean((error / with_lens) ** 2)) < 1.5
    assert np.sqrt(np.mean((error / of_corners) ** 2)) > 1.5
    # Many boards determine the lens, and the poses are as sure again as their corners are.
    many = with_lens_errors([found] * 400, [corners] * 400, CAMERA)
    assert np.trace(many[0].cov - found.cov) < 0.2 * np.trace(sure.cov - found.cov)


@pytest.mark.parametrize(("distortion", "faulty"), [(CAMERA.distortion, False), ((0.5, 0.0, 0.0, 0.0, 0.0), True)])
def test_corners_contradict_a_lens_that_is_not_theirs(distortion: tuple[float, ...], *, faulty: bool) -> None:
    rng = np.random.default_rng(5)
    seen = []
    for _ in range(10):
        T = pose(float(rng.uniform(0.25, 0.4)), tilt=tuple(rng.uniform(-0.5, 0.5, 3)))
        at = CAMERA.project((CHECKER.corners - T[:3, 3]) @ T[:3, :3])
        seen.append(replace(find_like(CHECKER), in_image=at + rng.normal(0, 0.05, at.shape)))
    found = lens_fault(replace(CAMERA, distortion=distortion), seen)
    assert (found is not None) == faulty
    if found is not None:
        assert found.camera.fx == CAMERA.fx
        assert found.fitted_px == pytest.approx(0.05 * np.sqrt(2), rel=0.15)
    assert lens_fault(replace(CAMERA, distortion=distortion), seen[:3]) is None
