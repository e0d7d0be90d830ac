# SPDX-License-Identifier: Apache-2.0
"""The demonstration: a virtual session recorded, replayed over DDS, labelled, compared with the truth, repaired, reported."""

from __future__ import annotations

import os
import shutil
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from typing import TYPE_CHECKING, Any

from tof_core.page import noted_command, set_command
from tof_eval.sessions import SessionErrors, session_errors
from tof_eval.tables import depth_table, methods_table, pose_table
from tof_scene.scene_file import load_scene
from tof_virtual.truth import load_truth
from toftwin.demo.correct import Corrected, correct
from toftwin.demo.diagnose import Diagnosed, diagnose
from toftwin.demo.inspect import Inspected, inspect
from toftwin.demo.repair import compare_methods
from toftwin.demo.replace import Replaced, replace_sensor
from toftwin.demo.sessions import TODAY, changed, later, today
from toftwin.inputs import opened
from toftwin.labelling import LabelResult, label_bag
from toftwin.pipeline import PipelineConfig
from toftwin.replay import ReplayResult, replay

if TYPE_CHECKING:
    from pathlib import Path

    from tof_eval.comparison import Comparison
    from toftwin.demo.config import DemoConfig

MARK = "made-by-toftwin-demo"


@dataclass(frozen=True, slots=True, eq=False)
class DemoResult:
    """Everything the report shows."""

    config: DemoConfig
    folder: Path
    replayed: ReplayResult
    labelled: LabelResult
    errors: SessionErrors
    diagnosed: Diagnosed
    corrected: Corrected
    inspected: Inspected
    replaced: Replaced
    comparison: Comparison
    seconds: dict[str, float]


def run_demo(out: Path, config: DemoConfig) -> DemoResult:
    """Write bag, scene, outputs of the graph, dataset and report.html to `out`, which is replaced as a whole."""
    part = out.with_name(out.name + ".part")
    shutil.rmtree(part, ignore_errors=True)
    part.mkdir(parents=True)
    (part / MARK).touch()
    seconds: dict[str, float] = {}
    path = _timed(seconds, "record", lambda: today(part, config))
    scene = load_scene(path)
    with ProcessPoolExecutor(1, get_context("spawn"), set_command, (noted_command(),)) as second:  # work that other steps do not wait for
        diagnosis = second.submit(diagnose, part / "gap", part / TODAY, path)
        repair = second.submit(compare_methods, part, path, config)
        replayed = _timed(seconds, "replay", lambda: _replay(part, path))
        labelled = _timed(seconds, "label", lambda: _label(part, path))
        poses = {"per-view ICP": labelled.others["per_view"], **live_poses(part / "graph")}
        truth, _ = load_truth(part / "truth")
        errors = _timed(seconds, "evaluate", lambda: session_errors(part / "dataset.zarr", truth, poses))
        _timed(seconds, "record the day after", lambda: later(part, scene, config, changed(scene, config)))
        corrected = _timed(seconds, "correct", lambda: correct(part, path, scene, config))
        diagnosed = _timed(seconds, "gap", diagnosis.result)
        inspected = _timed(seconds, "inspect", lambda: inspect(part, path, scene, config))
        replaced = _timed(seconds, "simulate", lambda: replace_sensor(part, path, scene, config))
        comparison = _timed(seconds, "repair", repair.result)
    result = DemoResult(config, part, replayed, labelled, errors, diagnosed, corrected, inspected, replaced, comparison, seconds)
    _timed(seconds, "report", lambda: _report(result, path))
    if out.exists():
        shutil.rmtree(out)
    part.replace(out)
    return result


def _timed(seconds: dict[str, float], name: str, work: Any) -> Any:
    print(f"{name} ...", file=sys.stderr, flush=True)
    began = time.monotonic()
    out = work()
    seconds[name] = time.monotonic() - began
    return out


def processor_seconds() -> float:
    """Of this process and its children that have ended."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


def _replay(folder: Path, scene: Path) -> ReplayResult:
    from tof_ros.player import PlayOptions

    config = PipelineConfig()
    with opened(folder / "bag", scene, config) as (reader, _):
        return replay(reader, config, scene=scene, options=PlayOptions(), record=folder / "graph")


def _label(folder: Path, scene: Path) -> LabelResult:
    config = PipelineConfig()
    with opened(folder / "bag", scene, config) as (reader, loaded):
        assert loaded is not None
        return label_bag(reader, loaded, config, folder, also=("per_view",))


def live_poses(run: Path) -> dict[str, list[Any]]:
    """Poses published by the graph, in the order of stamps."""
    from tof_core.se3 import from_quat
    from tof_eval.runs import parts, read_run

    found = sorted((stamp, parts(message)["pose"]) for (stamp, topic), message in read_run(run).items() if topic.endswith("label/pose"))
    return {"graph, live": [from_quat(p[:3], p[3:]) for _, p in found]}


def _report(result: DemoResult, scene: Path) -> None:
    from toftwin.demo.report import write_report

    write_report(result, scene)


def summary(result: DemoResult) -> str:
    """What the command prints."""
    from toftwin.demo.report import sentence

    r = result.replayed
    return "\n".join(
        [
            sentence(result),
            f"over DDS: {r.report.sent} frames sent, {r.report.fates['kept']} kept, {r.report.lost} lost; the graph used {r.memory_bytes / 1e6:.0f} MB",
            depth_table(result.errors.rows),
            pose_table(result.errors.poses),
            f"labels within two of their sigmas of the truth: {result.errors.honest:.1%}",
            f"sweep of the paper with the camera of the default network, {result.comparison.result['views']} views against the truth:",
            methods_table(result.comparison.result["methods"]),
            "seconds: "
            + ", ".join(f"{name} {s:.0f}" for name, s in result.seconds.items())
            + f"; {sum(result.seconds.values()):.0f} in all, {processor_seconds():.0f} of processor",
        ]
    )
