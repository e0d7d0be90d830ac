# SPDX-License-Identifier: Apache-2.0
"""Second process: the diagnosis runs on the bags alone."""

from __future__ import annotations

import json
import time
import traceback
from typing import TYPE_CHECKING

from benchmarks.gap_check.record import BAGS
from tof_core.errors import ToftwinError
from tof_core.progress import progress

if TYPE_CHECKING:
    from pathlib import Path

    from tof_gap.tell.diagnosis import Diagnosis
    from tof_scene.raycast import Raycaster

REPORTS = "reports"
DATA_SHEET = "sensor.yaml"
"""Beside a case's scene, where the camera's maker states something: what `--sensor` takes."""


def examine_all(folder: Path) -> None:
    """A report per bag under `reports/`; done ones are kept."""
    cases = sorted((folder / BAGS).iterdir())
    for case in progress(cases, "diagnosing", len(cases)):
        out = folder / REPORTS / case.name
        if not (out / "seconds.json").exists():
            examine(case, out)


def compare_all(folder: Path) -> None:
    """The two baselines on the same bags, under `reports/<case>/baselines.json`."""
    from benchmarks.gap_check.baselines import boosting, least_squares, session

    cases = sorted((folder / BAGS).iterdir())
    for case in progress(cases, "baselines", len(cases)):
        out = folder / REPORTS / case.name / "baselines.json"
        if out.exists() or not out.parent.exists():
            continue
        store, residual = session(case)
        out.write_text(json.dumps({"least squares": least_squares(store, residual), "boosting": boosting(store, residual)}))


def examine(case: Path, out: Path) -> None:
    """One bag to one report; a refusal is an answer too, and so is a fault."""
    from tof_gap.tell.report.files import write

    out.mkdir(parents=True, exist_ok=True)
    started, busy = time.perf_counter(), time.process_time()
    try:
        write(*diagnosed(case), out, [])
    except ToftwinError as error:
        (out / "refused.txt").write_text(str(error))
    except Exception:  # noqa: BLE001 - the other bags are diagnosed all the same, and this one counts as a miss
        (out / "refused.txt").write_text(traceback.format_exc())
    (out / "seconds.json").write_text(json.dumps({"wall_s": time.perf_counter() - started, "cpu_s": time.process_time() - busy}))


def diagnosed(case: Path) -> tuple[Diagnosis, Raycaster]:
    """The diagnosis of a case's bag, and its scene."""
    from tof_sensor.model import load_model
    from toftwin.diagnosis import GapPipelineConfig, diagnose_bag
    from toftwin.inputs import opened

    config = GapPipelineConfig()
    left_out = frozenset(json.loads((case / "list.json").read_text())["left_out"])
    sheet = case / "scene" / DATA_SHEET
    known = load_model(sheet) if sheet.exists() else None
    with opened(case / "bag", case / "scene" / "scene.yaml", config) as (reader, scene):
        assert scene is not None
        return diagnose_bag(reader, scene, config, known=known, left_out=left_out)
