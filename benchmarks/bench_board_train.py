# SPDX-License-Identifier: Apache-2.0
"""A network trained on one half of a real camera's frames of a board, judged on the other beside raw depth and the fitted sensor model."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.bench_board import BOARD, DATA, plane_errors
from benchmarks.figure import Figure, at_most

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.board.spec import Board
    from tof_core.capture import Capture, View
    from tof_scene.raycast import Raycaster
    from tof_sensor.model import SensorModel
    from toftwin.boarded import BoardSession

LONG = True
OUT = Path("out/bench/board_train")
THREADS, EPOCHS = 2, 60
EVERY_MM = 1000.0
"""Limit of sigma with which a network repairs every pixel, as a sensor model does; the card's own limit leaves the doubtful ones as measured."""


def run() -> list[Figure]:
    """Plane error of the other half, mean of two: a network, and one with simulated frames, against the fitted sensor model."""
    if not DATA.is_dir():
        return [Figure("a network before a board", float("nan"), "", remark="skipped: no ../shared/data beside the checkout")]
    from tof_core.board.spec import Board
    from tof_core.options import BagOptions
    from tof_scene.raycast import Raycaster
    from toftwin.boarded import board_session, read_captures

    captures, board = read_captures(DATA / "bag", BagOptions()), Board.parse(BOARD)
    session = board_session(captures, board)
    seen = {v.stamp_ns for v in session.views}
    captures, caster = [c for c in captures if c.stamp_ns in seen], Raycaster(session.scene)
    order = np.random.default_rng(0).permutation(len(session.views))
    halves = np.sort(order[: len(order) // 2]).tolist(), np.sort(order[len(order) // 2 :]).tolist()
    rows = [_judged(session, captures, board, caster, *pair, number) for number, pair in enumerate((halves, halves[::-1]))]
    raw, fitted, alone, both, alone_kept, both_kept = np.mean(rows, axis=0)
    shown = "; ".join(" / ".join(f"{x:.1f}" for x in row) for row in rows)
    remark = (
        f"raw {raw:.1f} mm; with the doubtful pixels left as measured {alone_kept:.1f} and {both_kept:.1f} mm; {EPOCHS} epochs; by half: raw / fitted"
        f" sensor / network / with simulated frames / both with doubtful pixels left: {shown}"
    )
    what = "Kinect v2 before a board: a network trained on one half repairs every pixel, plane error of the other"
    return [
        at_most(what, float(alone), float(fitted), "mm", remark=remark),
        at_most(f"{what}, half of its frames simulated by the fitted sensor", float(both), float(fitted), "mm"),
    ]


def _judged(
    session: BoardSession, captures: Sequence[Capture], board: Board, caster: Raycaster, fit: list[int], other: list[int], number: int
) -> tuple[float, ...]:
    """Mean plane error in mm of the views `other`: raw, less the fitted sensor's bias, repaired by either network, and by either where it is sure."""
    from tof_gap.tell.report.files import sensor_model
    from toftwin.diagnosis import GapPipelineConfig, diagnose_before_board

    model = sensor_model(diagnose_before_board(session, [session.views[i] for i in fit], caster, GapPipelineConfig()))
    views, beyond = [session.views[i] for i in other], [captures[i] for i in other]
    raw, fitted = plane_errors(views, caster, None), plane_errors(views, caster, model)
    networks = [
        _network([captures[i] for i in fit], board, OUT / f"{number}_{name}", sensor)
        for name, sensor in (("alone", None), ("simulated", model))
    ]
    repaired = [_repaired(network, views, beyond, caster, limit_mm) for limit_mm in (EVERY_MM, 0.0) for network in networks]
    row = (raw, fitted, *repaired)
    print(f"half {number}: " + " / ".join(f"{x:.2f}" for x in row) + " mm", flush=True)
    return row


def _network(captures: Sequence[Capture], board: Board, folder: Path, sensor: SensorModel | None) -> Path:
    """A network of these captures, labelled by the board that they show."""
    from benchmarks.reality_cameras import label_board
    from tof_infer.augment import Redraw
    from tof_infer.config import TrainConfig
    from tof_infer.train import train
    from tof_sim_label.dataset import open_dataset
    from toftwin.board_training import near_labels

    shutil.rmtree(folder, ignore_errors=True)
    data = label_board(captures, board, folder)
    redraw = None if sensor is None else Redraw(sensor, open_dataset(data).camera)
    train([data], folder / "model.onnx", near_labels(TrainConfig(threads=THREADS, epochs=EPOCHS)), redraw=redraw)
    return folder / "model.onnx"


def _repaired(network: Path, views: Sequence[View], captures: Sequence[Capture], caster: Raycaster, limit_mm: float) -> float:
    """Mean plane error in mm of the views as the network repairs them; a pixel that it leaves alone counts as measured. `limit_mm`: of sigma, 0 the card's."""
    from dataclasses import replace

    from tof_infer.config import InferConfig
    from tof_infer.session import Session

    session = Session(InferConfig(model=str(network), force=True, max_sigma_mm=limit_mm))
    repaired = [replace(v, depth=session.repair(c).depth) for v, c in zip(views, captures, strict=True)]
    return plane_errors(repaired, caster, None)
