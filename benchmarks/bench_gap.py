# SPDX-License-Identifier: Apache-2.0
"""The gap diagnosis in short: a handful of withheld effects, and the time and memory of twenty views of 400x300."""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.figure import Figure, at_least, at_most
from benchmarks.gap_check.cases import Case
from benchmarks.gap_check.record import record_all
from benchmarks.gap_check.score import score_all

HANDFUL: tuple[tuple[str, dict[str, float], str], ...] = (
    ("null", {}, "pipework"),
    ("single-usual", {"wiggling": 1.0}, "body_section"),
    ("single-usual", {"multipath": 1.0}, "housing"),
    ("single-usual", {"noise": 1.0}, "pipework"),
    ("single-usual", {"cad_deviation": 1.0}, "body_section"),
    ("pair", {"temperature_drift": 1.0, "amplitude_bias": 1.0}, "housing"),
)
"""One session of several kinds; how often it is right is `python -m benchmarks.gap_check`'s to say."""


def run() -> list[Figure]:
    """The handful, then the twenty views."""
    return [*handful(), *twenty()]


def handful() -> list[Figure]:
    """Named or not, and the seconds of a case."""
    with tempfile.TemporaryDirectory() as folder:
        cases = [Case(f"case{i:04d}", kind, scene, e, "", 900 + i, 80.0) for i, (kind, e, scene) in enumerate(HANDFUL)]
        record_all(cases, Path(folder), (224, 171))
        subprocess.run(
            [sys.executable, "-m", "benchmarks.gap_check", "--step", "examine", "--out", folder], check=True, capture_output=True
        )
        rows = score_all(Path(folder))
    missed = "; ".join(f"{'+'.join(r.truth) or 'null'} -> {', '.join(r.verdict)}" for r in rows if not r.hit)
    share = 100.0 * sum(r.hit for r in rows) / len(rows)
    slowest = max(r.seconds for r in rows)
    busy = sum(r.cpu_s for r in rows) / len(rows)
    return [
        at_least("gap: withheld effects of six sessions named, 12 views 224x171", share, 80.0, "%", remark=missed),
        at_most("gap: slowest of the six diagnoses", slowest, 10.0, "s", remark=f"{busy:.1f} s of processor on average; load {_load()}"),
    ]


def twenty() -> list[Figure]:
    """`toftwin gap` on twenty views of 400x300, as a process of its own."""
    from tof_core.config import from_mapping
    from tof_scene.builtin import write_builtin
    from tof_scene.scene_file import load_scene
    from tof_virtual.config import VirtualConfig
    from tof_virtual.record import record
    from toftwin.commands.simulate import bodies_of

    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        scene = write_builtin("body_section", folder / "scene")
        size = {"seed": 4, "camera.width": 400, "camera.height": 300, "plan.views": 20, "plan.stations": 2, "plan.pause_s": 15.0}
        record(bodies_of(load_scene(scene)), folder / "bag", from_mapping(VirtualConfig, size), effects={"wiggling": 1.0})
        call = [sys.executable, "-m", "toftwin.cli", "gap", str(folder / "bag"), "--scene", str(scene), "--out", str(folder / "gap")]
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        started = time.perf_counter()
        subprocess.run(call, check=True, capture_output=True)
        wall = time.perf_counter() - started
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        verdict = json.loads((folder / "gap" / "gap.json").read_text())["verdict"]
    busy = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    remark = f"report and all; {busy:.0f} s of processor; load {_load()}; named {', '.join(verdict)} of a wiggle"
    return [
        at_most("gap: twenty views of 400x300, two cores", wall, 60.0, "s", remark=remark),
        at_most("gap: memory for it", after.ru_maxrss / 2**20, 3.0, "GB"),
    ]


def _load() -> str:
    return f"{os.getloadavg()[0]:.1f} on {len(os.sched_getaffinity(0))} cores"
