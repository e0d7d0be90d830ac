# SPDX-License-Identifier: Apache-2.0
"""Promises kept: a second session of each camera, and how far the sensor.yaml of the first shrinks its gap."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.gap_check.examine import REPORTS
from benchmarks.gap_check.foreign.cases import ForeignCase
from benchmarks.gap_check.record import BAGS, SEALED
from tof_core.progress import progress

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

SECOND = "second"


@dataclass(frozen=True, slots=True)
class Promised:
    """A case: the shrink that the first session stated, that of the second, and the verdict on what the model leaves there."""

    case: str
    named: tuple[str, ...]
    promised: float
    kept: float
    left: tuple[str, ...]


def keep_promises(folder: Path) -> list[Promised]:
    """Of every case that a report states a shrink for: record a second session, diagnose it with the first one's sensor.yaml."""
    cases = [c for c in sorted((folder / REPORTS).iterdir()) if _states_a_shrink(c)]
    return [row for c in progress(cases, "second sessions", len(cases)) if (row := _one(folder, c.name)) is not None]


def _states_a_shrink(report: Path) -> bool:
    if not (report / "gap.json").exists():
        return False
    found = json.loads((report / "gap.json").read_text())
    return found["gap"]["shrink"] is not None and any(c["asserted"] and c["size_mm"] is not None for c in found["causes"])


def _one(folder: Path, name: str) -> Promised | None:
    from tof_gap.tell.report.kept import kept
    from tof_sensor.model import load_model
    from toftwin.diagnosis import GapPipelineConfig, diagnose_bag
    from toftwin.inputs import opened

    out = folder / SECOND / name
    if not (out / "kept.json").exists():
        _record(folder, name)
        config, known = GapPipelineConfig(), load_model(folder / REPORTS / name / "sensor.yaml")
        with opened(out / "bag", folder / BAGS / name / "scene" / "scene.yaml", config) as (reader, scene):
            assert scene is not None
            diagnosis, _ = diagnose_bag(reader, scene, config, known=known)
        found = kept(diagnosis, known)
        assert found is not None, "a report that states a shrink names a bias"
        (out / "kept.json").write_text(json.dumps(found.to_dict() | {"verdict": list(diagnosis.verdict)}))
    row = json.loads((out / "kept.json").read_text())
    if row["kept"]["shrink"] is None or row["promised"] is None:
        return None
    causes = json.loads((folder / REPORTS / name / "gap.json").read_text())["causes"]
    named = tuple(c["effect"] for c in causes)
    return Promised(name, named, row["promised"]["shrink"], row["kept"]["shrink"], tuple(row["verdict"]))


def _record(folder: Path, name: str) -> None:
    """The case's camera and causes in the case's cell, on another day: other poses, errors of the robot and noise."""
    from benchmarks.emerging.record import record
    from benchmarks.gap_check.foreign.record import planned

    out = folder / SECOND / name
    if (out / "bag").exists():
        return
    out.mkdir(parents=True, exist_ok=True)
    answer = json.loads((folder / SEALED / name / "case.json").read_text())
    case = ForeignCase(**{k: answer[k] for k in ForeignCase.__dataclass_fields__})
    truth = json.loads((folder / SEALED / name / "truth.json").read_text())
    width, height = truth["config"]["camera"]["width"], truth["config"]["camera"]["height"]
    session = planned(case, out / "scene", (width, height), again=1)
    session.sizes = {cause: found["size"] for cause, found in truth["causes"].items()}
    record(session, out / "bag", out / "truth", case.causes, {cause: found["reached"] for cause, found in truth["causes"].items()})


def table(rows: Sequence[Promised]) -> str:
    """A line per case, then the quantiles of what was kept less what was promised."""
    if not rows:
        return "no report states a shrink"
    lines = [
        f"{r.case}  {', '.join(r.named):40s} promised {r.promised:5.0%}  kept {r.kept:5.0%}  what is left: {', '.join(r.left)}"
        for r in rows
    ]
    off = 100 * np.abs([r.kept - r.promised for r in rows])
    lines.append(
        f"{len(rows)} second sessions: off the promise by {np.median(off):.0f} points (median), {np.quantile(off, 0.9):.0f} (90 %)"
    )
    return "\n".join(lines)
