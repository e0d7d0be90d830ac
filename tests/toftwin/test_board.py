# SPDX-License-Identifier: Apache-2.0
"""`toftwin gap --board`: a camera before a checkerboard, without robot and CAD."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import TYPE_CHECKING

import cv2
import numpy as np
import pytest

from tests.tof_core.board.drawn import CAMERA, draw, pose
from tof_align.config import AlignConfig
from tof_core.board.spec import Board
from tof_core.calibration import BoardLimits, Calibration, load_calibration
from tof_core.capture import Capture
from tof_core.errors import RefusedError
from tof_core.image_folder import read_camera
from tof_core.options import BagOptions
from tof_core.yamlio import load_yaml
from tof_gap.config import GapConfig
from tof_gap.solve.radial import median_miss
from tof_gap.solve.start import start
from tof_gap.solve.tolerance import calibrated
from tof_gap.solved import Named
from tof_scene.board import BLACK, WHITE
from tof_scene.raycast import Raycaster
from tof_sensor.effects.depth_scale import DepthScale
from tof_sensor.effects.intrinsics import Intrinsics
from tof_sensor.effects.z_conversion import ZConversion
from tof_sim_label.dataset import open_dataset
from toftwin.boarded import HELD_MM, PRINT_SCALE_PCT, BoardSource, board_session, posed_by_board, read_captures, save_lens
from toftwin.cli import main
from toftwin.diagnosis import TURN_DEG, GapPipelineConfig, diagnose_before_board, lens_finding, turning
from toftwin.labelling import label_bag
from toftwin.pipeline import PipelineConfig

if TYPE_CHECKING:
    from pathlib import Path

BOARD = Board.parse("5x7x0.030")
NOISE_M, WALK_M, REFERENCE = 0.0015, 0.012, 4000.0
"""Noise of a pixel at the reference amplitude (photons: it goes as the root of amplitude); by how much dark squares are measured farther than white ones (metres)."""
PLAIN = replace(CAMERA, distortion=())


def captures(count: int = 10, *, walk_m: float = WALK_M, seed: int = 0, noiseless: bool = False) -> list[Capture]:
    """Views of the board from poses that differ in distance and tilt."""
    rng = np.random.default_rng(seed)
    rays, out = PLAIN.rays(), []
    for k in range(count):
        T = pose(0.36 + 0.03 * k, tilt=tuple(rng.uniform(-0.4, 0.4, 3)))
        direction = rays @ T[:3, :3].T
        z = -T[2, 3] / direction[..., 2]
        lit = draw(BOARD, T, PLAIN) / z**2
        depth = z + walk_m * np.log(REFERENCE / lit) / np.log(8.0) + NOISE_M * np.sqrt(REFERENCE / lit) * rng.standard_normal(z.shape)
        depth = z if noiseless else depth
        reason = np.zeros(z.shape, np.uint8)
        out.append(Capture(k * 10**9, PLAIN, depth.astype(np.float32), reason, amplitude=lit.astype(np.float32)))
    return out


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The captures as PNG pairs."""
    path = tmp_path_factory.mktemp("board")
    for k, c in enumerate(captures()):
        assert c.amplitude is not None
        cv2.imwrite(str(path / f"depth_{k:03}.png"), np.rint(1e3 * c.depth).astype(np.uint16))
        cv2.imwrite(str(path / f"ir_{k:03}.png"), np.rint(2.0 * c.amplitude).clip(0, 65535).astype(np.uint16))
    K = [PLAIN.fx, 0.0, PLAIN.cx, 0.0, PLAIN.fy, PLAIN.cy, 0.0, 0.0, 1.0]
    (path / "camera.yaml").write_text(
        json.dumps(
            {"image_width": PLAIN.width, "image_height": PLAIN.height, "camera_matrix": {"data": K}, "distortion_model": "plumb_bob"}
        )
    )
    return path


def test_the_board_is_the_scene_and_gives_the_poses() -> None:
    session = board_session(captures(4), BOARD)
    assert len(session.views) == 4
    white, black = session.scene.part(WHITE), session.scene.part(BLACK)
    assert white.material.albedo / black.material.albedo == pytest.approx(8.0, rel=0.1)
    assert session.align(AlignConfig()).priors.base_mm == HELD_MM
    assert session.lens_fault is None
    for view, known in zip(session.views, session.poses, strict=True):
        assert view.robot is not None
        np.testing.assert_array_equal(view.robot.cov, known.cov)
    for view in session.views:
        assert view.robot is not None
        assert view.robot.T_cell_camera[2, 3] < 0


def test_image_folders_follow_scale_and_meaning_of_depth(folder: Path) -> None:
    plain, scaled, radial = (
        read_captures(folder, options)[0] for options in (BagOptions(), BagOptions(depth_scale=0.0005), BagOptions(depth="radial"))
    )
    np.testing.assert_allclose(scaled.depth, 0.5 * plain.depth, rtol=1e-6)
    np.testing.assert_allclose(radial.depth, plain.depth / plain.camera.ray_length(), rtol=1e-6)


def test_captures_without_the_board_are_counted_and_left_out() -> None:
    some = captures(3)
    blind = replace(some[1], amplitude=np.full(PLAIN.shape, 100.0, np.float32))
    source = BoardSource([some[0], blind, some[2]], BOARD)
    assert source.frame_count == 2
    assert source.skipped["board"] == 1
    assert "2 of 3" in source.note


def test_no_amplitude_and_no_board_are_refusals() -> None:
    some = captures(2)
    with pytest.raises(RefusedError, match="no capture has an amplitude image"):
        board_session([replace(c, amplitude=None) for c in some], BOARD)
    with pytest.raises(RefusedError, match="found in none of 2"):
        board_session(some, Board.parse("4x9x0.030"))


def test_gap_names_what_goes_with_amplitude_and_nothing_else(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["gap", str(folder), "--board", "5x7x0.030", "--out", str(tmp_path / "gap"), "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["verdict"] == ["amplitude_bias"]
    assert report["gap"]["shrink"] > 0.9
    assert "flat and whole" in report["not_testable"]["cad_deviation"]
    assert (tmp_path / "gap" / "sensor.yaml").exists()


def test_a_lens_that_the_corners_contradict_is_named_and_replaced() -> None:
    seen = captures(12)
    bent = replace(PLAIN, distortion=(0.3, -0.2, 0.004, -0.004, 0.0))
    session = board_session([replace(c, camera=bent) for c in seen], BOARD)
    fault = session.lens_fault
    assert fault is not None
    assert fault.stated_px > 1.05 * fault.fitted_px
    assert session.camera == fault.camera
    np.testing.assert_allclose(session.camera.distortion[:4], 0.0, atol=0.1)
    assert session.camera.fx == PLAIN.fx
    found = lens_finding(fault)
    assert found.name == "intrinsics"
    assert isinstance(found.effect, Intrinsics)
    np.testing.assert_allclose(found.effect.camera(bent).distortion[:4], session.camera.distortion[:4], atol=1e-9)
    d = diagnose_before_board(session, session.views, Raycaster(session.scene), GapPipelineConfig())
    assert d.verdict == ("amplitude_bias", "intrinsics")


def test_scene_and_board_exclude_each_other(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["gap", str(folder), "--out", str(tmp_path)]) == 2
    assert "neither a scene nor a board" in capsys.readouterr().err
    assert main(["gap", str(folder), "--board", "5x7x0.030", "--scene", "x.yaml", "--out", str(tmp_path)]) == 2
    assert main(["gap", str(folder), "--board", "5x7", "--out", str(tmp_path)]) == 2


def test_labels_are_independent_of_the_range_error_and_rate_a_method(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Dark squares are 12 mm too far: the label keeps the board's plane, where a solution that uses depth would follow them."""
    assert main(["label", str(folder), "--board", "5x7x0.030", "--out", str(tmp_path / "label"), "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["views"] == 10
    assert result["verdicts"] == {"robot": 10}
    dataset = open_dataset(tmp_path / "label" / "dataset.zarr")
    assert len(np.unique(dataset.column("views/station"))) == 10
    true = {c.stamp_ns: c for c in captures(noiseless=True)}
    for v, stamp in enumerate(dataset.column("views/stamp_ns")):
        label, mask = dataset.frame("views/label", v), dataset.frame("views/mask", v) > 0
        assert mask.sum() > 1000
        assert np.abs(label - true[int(stamp)].depth)[mask].max() < 0.002
    assert result["raw"]["mae"] > 0.003
    assert main(["evaluate", str(folder), "--board", "5x7x0.030", "--methods", "raw,rules", "--json"]) == 0
    judged = json.loads(capsys.readouterr().out)
    assert judged["views"] == 10
    assert "corners" in judged["reference"]


def test_boards_that_depth_misses_everywhere_are_labelled_all_the_same(tmp_path: Path) -> None:
    """Depth is off by a metre: no view fits the board's plane, and the poses are those of the corners."""
    far = [replace(c, depth=c.depth + np.float32(1.0)) for c in captures(3)]
    source, config = BoardSource(far, BOARD, apart=True), PipelineConfig()
    config = replace(config, align=posed_by_board(source, config.align))
    result = label_bag(source, source.session.scene, config, tmp_path, mode="robot")
    assert result.verdicts == {"robot": 3}


@pytest.mark.parametrize(("stated_m", "ratio", "measured_mm"), [(0.035, "0.857", "30.0"), (0.025, "1.2", "30.0")])
def test_squares_of_another_size_than_stated_are_refused_with_their_size_by_depth(stated_m: float, ratio: str, measured_mm: str) -> None:
    seen = captures(3, walk_m=0.0)
    with pytest.raises(
        RefusedError, match=rf"depth on the board is {ratio}.* squares are {measured_mm} mm wide, and {1e3 * stated_m:g} mm are"
    ):
        BoardSource(seen, replace(BOARD, size_m=stated_m))


def test_boards_are_labelled_one_bag_at_a_time(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["label", str(folder), str(folder), "--board", "5x7x0.030", "--out", str(tmp_path / "out")]) == 2
    assert "a batch is of one scene" in capsys.readouterr().err


def test_a_calibrated_lens_is_written_with_standard_deviations_for_later_sessions(tmp_path: Path) -> None:
    session = board_session(captures(10), BOARD, calibrate=True)
    save_lens(session, tmp_path)
    assert read_camera(tmp_path / "camera.yaml") == replace(session.camera, frame_id="camera")
    assert session.lens_std is not None
    values = load_yaml(tmp_path / "camera.yaml")["standard_deviations"]
    assert values["cx"] == pytest.approx(session.lens_std[2])
    stated = load_calibration(tmp_path / "calibration.yaml")
    np.testing.assert_allclose(stated.lens_sd[2:], np.sqrt(np.mean(session.lens_std[2:4] ** 2)), rtol=1e-9)
    assert session.calibration(Calibration()).lens == stated.lens


def test_a_scale_within_the_print_scale_is_the_boards() -> None:
    session = board_session(captures(3), BOARD)
    stated = session.calibration(Calibration())
    assert stated.board.print_scale_pct == PRINT_SCALE_PCT
    own = Calibration(board=BoardLimits(0.05))
    assert session.calibration(own).board == own.board

    def covered(scale: float, calibration: Calibration) -> bool:
        named = Named("depth_scale", (DepthScale(scale),), ({"scale": 1e-4},), (), 1.0)
        return calibrated(named, calibration, session.camera)

    assert covered(0.003, stated)
    assert not covered(0.0032, stated)
    assert not covered(0.003, own)
    assert not covered(0.003, Calibration())


def test_first_poses_are_those_of_the_corners_whatever_depth_says() -> None:
    """Depth that is 15 mm too far moves no pose, so distance along the ray still shows as such."""
    far = [replace(c, depth=c.depth + np.float32(0.015)) for c in captures(5, noiseless=True)]
    session = board_session(far, BOARD)
    begun = start(session.views, Raycaster(session.scene), GapConfig(), session.align(AlignConfig()))
    np.testing.assert_allclose(
        [begun.chain.pose(v) for v in range(5)], [v.robot.T_cell_camera for v in session.views if v.robot is not None], atol=1e-12
    )
    assert median_miss(begun.evidence) == pytest.approx(0.015, abs=0.003)
    evidence = begun.hand_over()
    assert len(evidence) == 5
    assert begun.evidence == ()


def test_a_view_s_pose_may_be_off_by_a_turn_about_the_board_s_middle() -> None:
    """Depth at the middle is as well known as by the corners; 0.1 m beside it, less well by that times the tangent of the turn."""
    session = board_session(captures(3), BOARD)
    (view, *_), caster = session.views, Raycaster(session.scene)
    assert view.robot is not None
    known = turning(view, caster.scene).robot
    assert known is not None
    assert known.cov is not None
    T, added = view.robot.T_cell_camera, known.cov - np.asarray(view.robot.cov)
    for aside, metres in ((np.zeros(3), 0.0), (np.array([0.1, 0.0, 0.0]), 0.1), (np.array([0.0, -0.1, 0.0]), 0.1)):
        p = T[:3, :3].T @ (np.array([0.06, 0.09, 0.0]) + aside - T[:3, 3])
        # A point of the board at p moves by -(v + w x p) in the camera frame; along the board's normal that is depth.
        lever = np.concatenate([T[2, :3], np.cross(p, T[2, :3])])
        assert np.sqrt(lever @ added @ lever) == pytest.approx(metres * np.radians(TURN_DEG), abs=1e-9)


def test_a_table_of_ray_lengths_that_is_mirrored_is_named_and_nothing_else() -> None:
    session = board_session([cut(c) for c in captures(10, walk_m=0.0)[2:]], BOARD)
    ratio = ZConversion(table="columns").published(session.camera)
    wrong = [replace(v, depth=(v.depth * ratio).astype(np.float32)) for v in session.views]
    found = diagnose_before_board(session, wrong, Raycaster(session.scene), GapPipelineConfig())
    assert found.verdict == ("z_conversion",)
    assert found.gap.shrink is not None
    assert found.gap.shrink > 0.9


def cut(capture: Capture) -> Capture:
    """The capture without its last 40 columns: the principal point is then 20 columns off the middle."""
    assert capture.amplitude is not None
    camera = replace(capture.camera, width=capture.camera.width - 40)
    return replace(
        capture, camera=camera, depth=capture.depth[:, :-40], amplitude=capture.amplitude[:, :-40], reason=capture.reason[:, :-40]
    )
