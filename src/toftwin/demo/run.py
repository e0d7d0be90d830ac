# SPDX-License-Identifier: Apache-2.0
"""The demonstration: a virtual session recorded, replayed over DDS, labelled, compared with the truth, repaired, reported."""

from __future__ import annotations

import os
import shutil
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import TYPE_CHECKING, Any

from tof_core.page import noted_command, set_command
from tof_core.shares import in_percent
from tof_eval.sessions import session_errors
from tof_eval.tables import depth_table, methods_table, pose_table
from tof_scene.scene_file import load_scene
from tof_virtual.truth import load_truth
from toftwin.demo.correct import correct
from toftwin.demo.diagnose import diagnose
from toftwin.demo.inspect import inspect
from toftwin.demo.repair import compare_methods
from toftwin.demo.replace import replace_sensor
from toftwin.demo.result import DemoResult, Spent
from toftwin.demo.sessions import TODAY, changed, later, today
from toftwin.inputs import opened
from toftwin.labelling import LabelResult, label_bag
from toftwin.pipeline import PipelineConfig
from toftwin.replay import ReplayResult, replay

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable
    from concurrent.futures import Future
    from pathlib import Path

    from toftwin.demo.config import DemoConfig

MARK = "made-by-toftwin-demo"


def measured(work: Callable[..., Any], *args: Any) -> tuple[Any, Spent]:
    """The result of a function, and the time that it took in this process."""
    began, before = time.monotonic(), processor_seconds()
    result = work(*args)
    return result, Spent(time.monotonic() - began, processor_seconds() - before)


def processor_seconds() -> float:
    """Processor time of this process and of its children that have ended, in seconds."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


def run_demo(out: Path, config: DemoConfig) -> DemoResult:
    """Write bag, scene, outputs of the graph, dataset and report.html to `out`, which is replaced as a whole."""
    part = out.with_name(out.name + ".part")
    shutil.rmtree(part, ignore_errors=True)
    part.mkdir(parents=True)
    (part / MARK).touch()
    spent, began = dict[str, Spent](), time.monotonic()
    path = _timed(spent, "record", lambda: today(part, config))
    scene = load_scene(path)
    with ProcessPoolExecutor(1, get_context("spawn"), set_command, (noted_command(),)) as second:  # work that other steps do not wait for
        diagnosis = second.submit(measured, diagnose, part / "gap", part / TODAY, path)
        repair = second.submit(measured, compare_methods, part, path, config)
        replayed = _timed(spent, "replay", lambda: _replay(part, path))
        labelled = _timed(spent, "label", lambda: _label(part, path))
        truth, _ = load_truth(part / "truth")
        poses = {"per-view ICP": labelled.others["per_view"], **live_poses(part / "graph", truth["stamp_ns"])}
        errors = _timed(spent, "evaluate", lambda: session_errors(part / "dataset.zarr", truth, poses))
        _timed(spent, "record the day after", lambda: later(part, scene, config, changed(scene, config)))
        simulation = second.submit(measured, replace_sensor, part, path, scene, config)  # after the diagnosis, whose sensor it takes
        corrected = _timed(spent, "correct", lambda: correct(part, path, scene, config))
        diagnosed, spent["gap"] = _waited("gap", diagnosis)
        inspected = _timed(spent, "inspect", lambda: inspect(part, path, scene, config))
        comparison, spent["repair"] = _waited("repair", repair)
        replaced, spent["simulate"] = _waited("simulate", simulation)
    result = DemoResult(config, part, replayed, labelled, errors, diagnosed, corrected, inspected, replaced, comparison, spent)
    _timed(spent, "report", lambda: _report(result, path))
    spent["all"] = Spent(time.monotonic() - began, processor_seconds())
    if out.exists():
        shutil.rmtree(out)
    part.replace(out)
    return result


def _timed(spent: dict[str, Spent], name: str, work: Callable[[], Any]) -> Any:
    print(f"{name} ...", file=sys.stderr, flush=True)
    out, spent[name] = measured(work)
    return out


def _waited(name: str, done: Future[tuple[Any, Spent]]) -> tuple[Any, Spent]:
    """The result of a step that runs beside the others."""
    print(f"{name} ...", file=sys.stderr, flush=True)
    return done.result()


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


def live_poses(run: Path, stamps: Iterable[int]) -> dict[str, list[Any]]:
    """Poses published by the graph, one for each stamp of a view; NaN where the view was refused and has none."""
    import numpy as np

    from tof_core.se3 import from_quat
    from tof_eval.runs import parts, read_run

    messages = ((stamp, parts(message)["pose"]) for (stamp, topic), message in read_run(run).items() if topic.endswith("label/pose"))
    found = {stamp: from_quat(p[:3], p[3:]) for stamp, p in messages}
    return {"graph, live": [found.get(int(stamp), np.full((4, 4), np.nan)) for stamp in stamps]}


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
            f"labels within two of their sigmas of the truth: {in_percent(result.errors.honest, 1)}",
            f"sweep of the paper with the camera of the default network, {result.comparison.result['views']} views against the truth:",
            methods_table(result.comparison.result["methods"]),
            "seconds (of processor): "
            + ", ".join(f"{name} {s.seconds:.0f} ({s.processor:.0f})" for name, s in result.spent.items())
            + "; gap, repair and simulate run beside the others",
        ]
    )
