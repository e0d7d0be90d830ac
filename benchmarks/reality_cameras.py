# SPDX-License-Identifier: Apache-2.0
"""Cameras that a network is trained for: labelled real views, the scene, the camera's model before and after its diagnosis, and held-out views with their truth."""

from __future__ import annotations

import json
import shutil
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.bench_board import BOARD, DATA
from tof_infer.config import TrainConfig
from tof_sensor.model import SensorModel, load_model, save_model

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from benchmarks.emerging.session import EmergingSession
    from benchmarks.gap_check.foreign.cases import ForeignCase
    from tof_core.arrays import Image, Ints
    from tof_core.board.spec import Board
    from tof_core.capture import Capture
    from tof_gap.tell.diagnosis import Diagnosis
    from tof_scene.scene import Scene
    from tof_sensor.effects.photon_law import PhotonLaw

EDGE = 0.03
"""Relative step of the true depth to a neighbouring pixel from which on a pixel lies at an edge: half a pixel of pose decides what it sees."""


@dataclass(frozen=True, slots=True, eq=False)
class Camera:
    """One camera.

    folder: of its files, among them `before.yaml` (its noise alone) and `after.yaml` (as diagnosed), with the unit of amplitude in both;
    dataset: labelled views to learn from; held: other captures, each with its true depth (H, W), NaN where none is judged; settings: of the training.
    """

    name: str
    folder: Path
    scene: Scene
    dataset: Path
    named: tuple[str, ...]
    held: list[tuple[Capture, Image]]
    settings: TrainConfig


def emerging(case: ForeignCase, size: tuple[int, int], folder: Path) -> Camera:
    """An emerging camera: labelled and diagnosed on one session, judged on a second in the same cell."""
    from benchmarks.gap_check.foreign.data_sheet import write_data_sheet
    from toftwin.diagnosis import GapPipelineConfig, diagnose_bag
    from toftwin.inputs import opened
    from toftwin.label_call import LabelCall
    from toftwin.pipeline import PipelineConfig

    scene_file = folder / "first" / "scene" / "scene.yaml"
    if not (folder / "after.yaml").exists():
        shutil.rmtree(folder, ignore_errors=True)
        session = _recorded(case, folder, size)
        LabelCall(str(folder / "first" / "bag"), scene_file, folder / "labels", PipelineConfig()).run()
        with opened(folder / "first" / "bag", scene_file, GapPipelineConfig()) as (reader, scene):
            assert scene is not None
            found, _ = diagnose_bag(reader, scene, GapPipelineConfig())
        write_data_sheet(session.healthy, session.camera, folder / "data_sheet.yaml")
        _save(found, load_model(folder / "data_sheet.yaml").law, folder)
    with opened(folder / "second" / "bag", scene_file, PipelineConfig()) as (reader, scene):
        captures = list(reader.captures())
    assert scene is not None
    truth = dict(np.load(folder / "second" / "truth.npz"))
    true = {int(stamp): _inside(depth, part) for stamp, depth, part in zip(truth["stamp_ns"], truth["depth"], truth["part"], strict=True)}
    held = [(c, true[c.stamp_ns]) for c in captures if c.stamp_ns in true]
    return Camera(case.name, folder, scene, folder / "labels" / "dataset.zarr", _named(folder), held, TrainConfig())


def before_board(folder: Path) -> Camera:
    """The Kinect v2: labelled and diagnosed on one half of its frames, judged on the other."""
    from tof_core.board.spec import Board
    from tof_core.options import BagOptions
    from tof_scene.raycast import Raycaster
    from tof_scene.render import render
    from toftwin.board_training import near_labels
    from toftwin.boarded import board_session, read_captures
    from toftwin.diagnosis import GapPipelineConfig, diagnose_before_board

    captures, board = read_captures(DATA / "bag", BagOptions()), Board.parse(BOARD)
    session = board_session(captures, board)
    by_stamp, caster = {c.stamp_ns: c for c in captures}, Raycaster(session.scene)
    order = np.random.default_rng(0).permutation(len(session.views))
    fit, other = ([session.views[i] for i in np.sort(half)] for half in np.array_split(order, 2))
    if not (folder / "after.yaml").exists():
        shutil.rmtree(folder, ignore_errors=True)
        label_board([by_stamp[v.stamp_ns] for v in fit], board, folder / "labels")
        found = diagnose_before_board(session, fit, caster, GapPipelineConfig())
        _save(found, found.law, folder)
    held = [(by_stamp[v.stamp_ns], render(caster, v.camera, v.robot.T_cell_camera).depth) for v in other if v.robot is not None]
    return Camera(
        "Kinect v2 before a board",
        folder,
        session.scene,
        folder / "labels" / "dataset.zarr",
        _named(folder),
        held,
        near_labels(TrainConfig()),
    )


def label_board(captures: Sequence[Capture], board: Board, folder: Path) -> Path:
    """A dataset of captures that are labelled by the board which they show."""
    from toftwin.boarded import BoardSource, posed_by_board
    from toftwin.labelling import label_bag
    from toftwin.pipeline import PipelineConfig

    source, config = BoardSource(captures, board, apart=True), PipelineConfig()
    label_bag(source, source.session.scene, replace(config, align=posed_by_board(source, config.align)), folder, mode="robot")
    return folder / "dataset.zarr"


def _recorded(case: ForeignCase, folder: Path, size: tuple[int, int]) -> EmergingSession:
    """Two sessions of one camera in one cell: `first` and `second`, each a bag with its truth beside."""
    from benchmarks.emerging.record import record
    from benchmarks.emerging.strength import calibrate
    from benchmarks.gap_check.foreign.record import planned

    first = planned(case, folder / "first" / "scene", size)
    reached = calibrate(first, case.causes)
    second = planned(case, folder / "second" / "scene", size, again=1)
    second.sizes = dict(first.sizes)
    for name, session in (("first", first), ("second", second)):
        record(session, folder / name / "bag", folder / name / "truth", case.causes, reached)
    return first


def _save(found: Diagnosis, law: PhotonLaw | None, folder: Path) -> None:
    from tof_gap.tell.report.files import sensor_model

    after = sensor_model(found)
    save_model(SensorModel(() if law is None else (law,), after.gain, after.camera), folder / "before.yaml")
    (folder / "verdict.json").write_text(json.dumps(found.verdict))
    save_model(after, folder / "after.yaml")


def _named(folder: Path) -> tuple[str, ...]:
    return tuple(json.loads((folder / "verdict.json").read_text()))


def _inside(depth: Image, part: Ints) -> Image:
    """(H, W) true depth of the CAD's parts away from edges, NaN elsewhere."""
    here, at_edge = np.where(part >= 0, depth, np.nan), np.zeros(depth.shape, bool)
    for axis in (0, 1):
        for way in (1, -1):
            with np.errstate(invalid="ignore"):
                at_edge |= ~(np.abs(here - np.roll(here, way, axis)) < EDGE * here)
    return np.where(at_edge, np.nan, here)
