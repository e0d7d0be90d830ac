# SPDX-License-Identifier: Apache-2.0
"""A session before a calibration board, without TF and CAD: poses from the board's corners in the amplitude image."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from tof_core.bag import open_bag
from tof_core.board.corners import find_corners
from tof_core.board.lens import calibrated, lens_fault, with_lens_errors
from tof_core.board.pose import board_pose
from tof_core.calibration import FILE, BoardLimits, Calibration, LensLimits, lens_limits, save_calibration
from tof_core.camera import radial_to_z
from tof_core.capture import RobotPose, View
from tof_core.cores import in_threads
from tof_core.errors import RefusedError
from tof_core.image_folder import CAMERA, is_image_folder, read_image_folder, write_camera
from tof_core.stats import robust_std
from tof_scene.board import board_scene

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from tof_align.config import AlignConfig
    from tof_core.arrays import Float
    from tof_core.bag import BagReader
    from tof_core.board.lens import LensFault
    from tof_core.board.pose import BoardPose
    from tof_core.board.spec import Board
    from tof_core.camera import Camera
    from tof_core.capture import Capture
    from tof_core.motion import MotionConfig
    from tof_core.options import BagOptions
    from tof_scene.scene import Scene

WHITE_ALBEDO = 0.8
"""Assumed albedo of the paper: amplitudes of unknown gain only show the ratio of the squares' albedos."""
HELD_MM, HELD_DEG = 1e-2, 1e-3
"""Prior standard deviations of base and hand-eye, which do not exist before a board."""
PRINT_SCALE_PCT = 0.3
"""Assumed largest error of a board's print scale in per cent: printers and paper differ by 0.1 to 0.3 %. Poses scale with it, so a depth_scale within it may be the board's error."""
OTHER_SIZE = 0.08
"""Relative difference of measured depth and the board's from which a wrong size of the squares is stated: cameras err by 5 % at half a metre, squares of 25 and 30 mm differ by 17 %."""
NOT_TESTABLE = {
    "cad_deviation": "the board is taken to be flat and whole",
    "hand_eye": "poses come from the board's corners, not from an arm",
}
"""Effects that a session before a board cannot test, with the reason."""


@dataclass(frozen=True, slots=True, eq=False)
class BoardSession:
    """Views with their poses from the board, the board as a scene, and the accuracy of the poses.

    skipped: stamps of captures in which the board was not found; lens_std (9,): standard deviations of a calibrated lens, None where
    CameraInfo's lens was kept; lens_fault: set where the corners contradict CameraInfo's lens, which the views then do not have.
    """

    views: tuple[View, ...]
    scene: Scene
    poses: tuple[BoardPose, ...]
    skipped: tuple[int, ...]
    camera: Camera
    lens_std: Float | None = None
    lens_fault: LensFault | None = None

    def calibration(self, stated: Calibration) -> Calibration:
        """The stated calibration, completed by the board's print scale and the accuracy of a lens calibrated from the corners."""
        board = stated.board if stated.board != BoardLimits() else BoardLimits(PRINT_SCALE_PCT)
        lens = stated.lens if self.lens_std is None or stated.lens != LensLimits() else lens_limits(self.camera, self.lens_std)
        return replace(stated, board=board, lens=lens)

    def align(self, config: AlignConfig) -> AlignConfig:
        """The alignment's settings with base and hand-eye held; each pose has the covariance of its own corners."""
        held = replace(config.priors, base_mm=HELD_MM, base_deg=HELD_DEG, hand_eye_mm=HELD_MM, hand_eye_deg=HELD_DEG)
        return replace(config, priors=held)


def posed_by_board(reader: BagReader | BoardSource, config: AlignConfig) -> AlignConfig:
    """Settings with which a session before a board keeps its poses from the corners; unchanged for a bag.

    These poses are independent of depth, so labels are independent of the camera's range errors.
    """
    return replace(reader.session.align(config), mode="robot") if isinstance(reader, BoardSource) else config


class BoardSource:
    """Captures before a board, with the interface of a bag's reader; each capture is one view, since the board or the camera is held by hand."""

    def __init__(self, captures: Sequence[Capture], board: Board, *, calibrate: bool = False, apart: bool = False) -> None:
        """Find the board in every capture; errors as of `board_session`.

        `apart` makes each view a separate station: datasets are divided by stations, and no two views have a common one.
        """
        self.session = board_session(captures, board, calibrate=calibrate)
        seen = [(v.stamp_ns, v.robot) for v in self.session.views if v.robot is not None]
        posed = {
            stamp: replace(robot, T_cell_body=robot.T_cell_camera, T_body_camera=np.eye(4)) if apart else robot for stamp, robot in seen
        }
        self._captures = [replace(c, camera=self.camera, robot=posed[c.stamp_ns]) for c in captures if c.stamp_ns in posed]
        self.skipped, self.last_error = Counter(board=len(self.session.skipped)), ""
        self.note = f"the board is found in {len(posed)} of {len(captures)} captures"
        if (fault := self.session.lens_fault) is not None:
            self.note += (
                f"; its corners are off by {fault.stated_px:.2f} px with the lens in camera_info: a lens fitted to them"
                f" ({fault.fitted_px:.2f} px) replaces it"
            )

    @property
    def camera(self) -> Camera:
        """The camera, with the fitted lens if one was fitted."""
        return self.session.camera

    @property
    def frame_count(self) -> int:
        """Number of captures with the board."""
        return len(self._captures)

    def captures(self, *, need_tf: bool = True) -> Iterator[Capture]:  # noqa: ARG002 (as a bag's reader is called)
        """The captures with the board, and their poses."""
        return iter(self._captures)

    def still(self, capture: Capture, gate: MotionConfig) -> bool:  # noqa: ARG002 (as a bag's reader is called)
        """False: no two captures are known to have the same pose."""
        return False


def save_lens(session: BoardSession, out: Path) -> None:
    """Write a calibrated lens with its standard deviations: `camera.yaml`, and `calibration.yaml` for later sessions in a scene."""
    assert session.lens_std is not None
    out.mkdir(parents=True, exist_ok=True)
    write_camera(session.camera, out / CAMERA, session.lens_std)
    save_calibration(Calibration(lens=lens_limits(session.camera, session.lens_std)), out / FILE)


def read_captures(path: str | Path, options: BagOptions) -> list[Capture]:
    """Captures of a bag, or of a folder of PNG pairs (`tof_core.image_folder`), without any pose."""
    if is_image_folder(Path(path)):
        captures = read_image_folder(Path(path), depth_scale=options.depth_scale)
        return captures if options.depth == "z" else [replace(c, depth=radial_to_z(c.camera, c.depth)) for c in captures]
    with open_bag(path, options) as reader:
        return list(reader.captures(need_tf=False))


def board_session(captures: Sequence[Capture], board: Board, *, calibrate: bool = False) -> BoardSession:
    """Find the board in every capture.

    Args:
        captures: depth with amplitude; no robot pose is needed.
        board: the board in view.
        calibrate: fit the lens to the corners instead of using CameraInfo's.

    Raises:
        RefusedError: no amplitude, the board is found in no capture, or its size contradicts the measured depth.
    """
    if all(c.amplitude is None for c in captures):
        raise RefusedError("no capture has an amplitude image", where="--board", todo="record the camera's IR or amplitude topic too")
    found = in_threads(lambda c: None if c.amplitude is None else find_corners(c.amplitude, board), captures)
    seen = [(c, f) for c, f in zip(captures, found, strict=True) if f is not None]
    if not seen:
        raise RefusedError(
            f"the board is found in none of {len(captures)} captures", where="--board", todo="count inner corners, and show the board whole"
        )
    camera, lens_std, fault = seen[0][0].camera, None, None
    if calibrate:
        camera, lens_std, _ = calibrated(camera, [f for _, f in seen])
    elif (fault := lens_fault(camera, [f for _, f in seen])) is not None:
        camera, lens_std = fault.camera, fault.std
    posed = [(replace(c, camera=camera), f, p) for c, f in seen if (p := board_pose(f, camera)) is not None]
    if not posed:
        raise RefusedError(
            f"the corners of {len(seen)} captures fit no pose of the board through this lens",
            where="--board",
            todo="check camera_info and the board's size, or fit the lens (--calibrate)",
        )
    sure = with_lens_errors([p for *_, p in posed], [f for _, f, _ in posed], camera)
    posed = [(c, f, p) for (c, f, _), p in zip(posed, sure, strict=True)]
    squares = [_squares(c, p, board) for c, _, p in posed]
    check_size(squares, board)
    views = tuple(replace(View.of_capture(c), robot=RobotPose(np.eye(4), p.T_board_camera, cov=p.cov)) for c, _, p in posed)
    black, white, odd_is_black = _albedos(squares, board)
    scene = board_scene(board, black, white, odd_is_black=odd_is_black)
    kept = {v.stamp_ns for v in views}
    return BoardSession(
        views, scene, tuple(p for *_, p in posed), tuple(c.stamp_ns for c in captures if c.stamp_ns not in kept), camera, lens_std, fault
    )


class Squares(NamedTuple):
    """Centres of the board's squares in one capture.

    at: (n, 3) metres in the camera frame, by the corners; off_plane_m: the camera's distance from the board's plane; amplitude, depth (n,):
    measured there, NaN outside the image.
    """

    at: Float
    off_plane_m: float
    amplitude: Float
    depth: Float


def _squares(capture: Capture, pose: BoardPose, board: Board) -> Squares:
    """What a capture measures at the centres of the board's squares."""
    lower, _ = board.squares
    centre = np.concatenate([lower + 0.5 * board.extent, np.zeros((len(lower), 1))], axis=1)
    R, t = pose.T_board_camera[:3, :3], pose.T_board_camera[:3, 3]
    at = (centre - t) @ R
    column, row = np.rint(capture.camera.project(at)).astype(int).T
    h, w = capture.depth.shape
    inside = (column >= 0) & (column < w) & (row >= 0) & (row < h)
    amplitude, depth = np.full((2, len(centre)), np.nan)
    assert capture.amplitude is not None
    amplitude[inside], depth[inside] = (image[row[inside], column[inside]] for image in (capture.amplitude, capture.depth))
    return Squares(at, float(abs(t[2])), amplitude, depth)


def check_size(squares: Sequence[Squares], board: Board) -> None:
    """Refuse a board whose size contradicts the measured depth: poses by corners scale with the size of the squares.

    Depth that is off by the same metres everywhere is the camera's error, and no other size.

    Raises:
        RefusedError: depth is more than `OTHER_SIZE` off in proportion to distance.
    """
    depth, ideal = np.concatenate([[s.depth, s.at[:, 2]] for s in squares], axis=1)
    depth, ideal = depth[np.isfinite(depth)], ideal[np.isfinite(depth)]
    scale, stated_mm = float(np.median(depth / ideal)) if len(depth) else 1.0, 1e3 * board.size_m
    if abs(scale - 1.0) <= OTHER_SIZE or robust_std(depth - scale * ideal) >= robust_std(depth - ideal):
        return
    raise RefusedError(
        f"depth on the board is {scale:.3g} times what its corners say: by the camera's depth the squares are {scale * stated_mm:.1f} mm wide, and {stated_mm:g} mm are stated",
        where="--board",
        todo="measure a square on the paper; if its size is right, check the unit of depth (--depth-scale) and the focal length in camera_info",
    )


def _albedos(squares: Sequence[Squares], board: Board) -> tuple[float, float, bool]:
    """Albedo of black and white squares, and whether odd squares are black, from the amplitude at the squares' centres."""
    _, odd = board.squares
    levels = [s.amplitude * (s.at**2).sum(axis=1) ** 1.5 / s.off_plane_m for s in squares]
    level = np.nanmedian(np.stack(levels), axis=0)
    even, other = (float(np.nanmedian(level[odd == k])) if (odd == k).any() else np.nan for k in (0, 1))
    if not np.isfinite(other):
        return WHITE_ALBEDO, WHITE_ALBEDO, False
    dark, light = min(even, other), max(even, other)
    return WHITE_ALBEDO * dark / max(light, 1e-12), WHITE_ALBEDO, other < even
