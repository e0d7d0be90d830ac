# SPDX-License-Identifier: Apache-2.0
"""Two sessions of each of some emerging cameras: five labelled views to calibrate by, and later views with their truth to score by."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.gap_check.foreign.cases import ROBOTS, ForeignCase, draw_foreign
from benchmarks.gap_check.foreign.record import planned, record_foreign
from benchmarks.gap_check.record import BAGS, SEALED
from benchmarks.recorded import FOLDER

if TYPE_CHECKING:
    from pathlib import Path

SIZE = (224, 171)
VIEWS, CALIBRATION_VIEWS = 20, 5


@dataclass(frozen=True, slots=True)
class CameraSessions:
    """Folders of one camera. `scored`: bag of the views that are scored, `truth`: their true depth (.npz); `calibration`: bag, scene and labels of the five views."""

    name: str
    causes: tuple[str, ...]
    scored: Path
    truth: Path
    calibration: Path

    @property
    def scene(self) -> Path:
        """The scene file of the cell, as the user has it."""
        return self.calibration / "scene" / "scene.yaml"

    @property
    def dataset(self) -> Path:
        """What `toftwin label` makes of the five views."""
        return self.calibration / "label" / "dataset.zarr"

    def label_error_mm(self) -> float:
        """Mean absolute error of the five views' labels, where they may be used, against the truth."""
        from tof_sim_label.dataset import open_dataset

        data = open_dataset(self.dataset)
        with np.load(self.calibration / "truth.npz") as truth:
            number, depth = {int(stamp): k for k, stamp in enumerate(truth["stamp_ns"])}, truth["depth"]
        off = [
            (data.frame("views/label", v) - depth[number[int(stamp)]])[data.frame("views/mask", v) > 0]
            for v, stamp in enumerate(data.column("views/stamp_ns"))
            if int(stamp) in number
        ]
        return 1e3 * float(np.nanmean(np.abs(np.concatenate(off))))


def camera_sessions(count: int, seed: int) -> list[CameraSessions]:
    """The sessions of the first `count` cameras that this seed draws; recorded and labelled where they are missing.

    Cameras whose five views `toftwin label` refuses have no dataset.
    """
    folder = FOLDER / f"adapt-{seed}"
    cases = draw_foreign(count, seed, VIEWS)
    record_foreign(cases, folder, SIZE)
    out = []
    for case in cases:
        one = CameraSessions(
            case.name,
            tuple(sorted(case.causes)),
            folder / BAGS / case.name / "bag",
            folder / SEALED / case.name / "truth.npz",
            folder / "calibration" / case.name,
        )
        if not (one.calibration / "bag").exists():
            _record_calibration(case, folder / SEALED / case.name / "truth.json", one.calibration)
        if not (one.calibration / "label").exists():
            _label(one)
        out.append(one)
    return out


def _record_calibration(case: ForeignCase, truth: Path, folder: Path) -> None:
    """Five views of the same camera in the same cell, with other poses, other errors of the robot and other noise."""
    from benchmarks.emerging.record import record
    from benchmarks.emerging.session import EmergingSession
    from tof_core.config import from_mapping
    from tof_virtual.config import VirtualConfig

    folder.mkdir(parents=True, exist_ok=True)
    first = planned(case, folder / "scene", SIZE)
    values = {
        "seed": case.seed + 1,
        "camera.width": SIZE[0],
        "camera.height": SIZE[1],
        "plan.capture_moving": case.moving,
        **ROBOTS[case.robot],
        **case.settings,
        "plan.views": CALIBRATION_VIEWS,
    }
    causes = json.loads(truth.read_text())["causes"]
    sizes = {cause: found["size"] for cause, found in causes.items()}
    # The world stays as it is: the parts that the long session saw most are those that stand off.
    session = EmergingSession(first.bodies, from_mapping(VirtualConfig, values), first.healthy, sizes, seen=first.shares())
    record(session, folder / "bag", folder / "truth", case.causes, {cause: found["reached"] for cause, found in causes.items()})


def _label(one: CameraSessions) -> None:
    from tof_core.errors import RefusedError
    from toftwin.inputs import opened
    from toftwin.labelling import label_bag
    from toftwin.pipeline import PipelineConfig

    config = PipelineConfig()
    try:
        with opened(one.calibration / "bag", one.scene, config) as (reader, scene):
            assert scene is not None
            label_bag(reader, scene, config, one.calibration / "label")
    except RefusedError as error:
        print(f"{one.name}: {error}", flush=True)
