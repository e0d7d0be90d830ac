# SPDX-License-Identifier: Apache-2.0
"""The demonstration: a virtual session recorded, replayed over DDS, labelled, compared with the truth, repaired, reported."""

from __future__ import annotations

import shutil
import sys
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from tof_core.config import from_mapping, param
from tof_eval.sessions import SessionErrors, session_errors
from tof_eval.tables import depth_table, methods_table, pose_table
from tof_virtual.truth import load_truth
from toftwin.demo_repair import compare_methods
from toftwin.inputs import opened
from toftwin.labelling import LabelResult, label_bag
from toftwin.pipeline import PipelineConfig
from toftwin.replay import ReplayResult, replay

if TYPE_CHECKING:
    from pathlib import Path

    from tof_eval.comparison import Comparison

MARK = "made-by-toftwin-demo"


@dataclass(frozen=True, slots=True)
class DemoConfig:
    """What the demonstration records."""

    scene: str = param("body_section", "built-in scene")
    width: int = param(400, "columns of the camera", unit="px", low=32, high=1000)
    height: int = param(300, "rows of the camera", unit="px", low=32, high=1000)
    views: int = param(12, "views of the session", low=1, high=200)
    stations: int = param(3, "stations of the base", low=1, high=50)
    captures: int = param(8, "captures of each view", low=1, high=100)
    effects: str = param("wiggling=1,multipath=1", "effects of the camera and their strengths")
    sweep_views: int = param(11, "views of the sweep on which raw, rules and network are compared", low=1, high=100)
    seed: int = param(1, "seed of everything random", low=0)


@dataclass(frozen=True, slots=True, eq=False)
class DemoResult:
    """Everything the report shows."""

    config: DemoConfig
    folder: Path
    replayed: ReplayResult
    labelled: LabelResult
    errors: SessionErrors
    comparison: Comparison
    seconds: dict[str, float]


def run_demo(out: Path, config: DemoConfig) -> DemoResult:
    """Write bag, scene, outputs of the graph, dataset and report.html to `out`, which is replaced as a whole."""
    part = out.with_name(out.name + ".part")
    shutil.rmtree(part, ignore_errors=True)
    part.mkdir(parents=True)
    (part / MARK).touch()
    seconds: dict[str, float] = {}
    scene = _timed(seconds, "record", lambda: _record(part, config))
    replayed = _timed(seconds, "replay", lambda: _replay(part, scene))
    labelled = _timed(seconds, "label", lambda: _label(part, scene))
    poses = {"per-view ICP": labelled.others["per_view"], **live_poses(part / "graph")}
    truth, _ = load_truth(part / "truth")
    errors = _timed(seconds, "evaluate", lambda: session_errors(part / "dataset.zarr", truth, poses))
    comparison = _timed(seconds, "repair", lambda: compare_methods(part, scene, config))
    result = DemoResult(config, part, replayed, labelled, errors, comparison, seconds)
    _timed(seconds, "report", lambda: _report(result, scene))
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


def _record(folder: Path, config: DemoConfig) -> Path:
    from tof_scene.builtin import write_builtin
    from tof_scene.scene_file import load_scene
    from tof_virtual.config import VirtualConfig
    from tof_virtual.record import record
    from toftwin.commands.simulate import bodies_of, parse_effects

    scene = write_builtin(config.scene, folder / "scene")
    values = {
        "camera.width": config.width,
        "camera.height": config.height,
        "plan.views": config.views,
        "plan.stations": config.stations,
        "plan.captures": config.captures,
        "output.colour": True,
        "seed": config.seed,
    }
    effects = parse_effects([e for e in config.effects.split(",") if e])
    record(bodies_of(load_scene(scene)), folder / "bag", from_mapping(VirtualConfig, values), effects=effects, truth_path=folder / "truth")
    return scene


def _replay(folder: Path, scene: Path) -> ReplayResult:
    from tof_ros.player import PlayOptions

    config = PipelineConfig()
    with opened(folder / "bag", scene, config) as (reader, _):
        return replay(reader, config, scene=scene, options=PlayOptions(), record=folder / "graph")


def _label(folder: Path, scene: Path) -> LabelResult:
    from tof_scene.raycast import Raycaster

    config = PipelineConfig()
    with opened(folder / "bag", scene, config) as (reader, loaded):
        assert loaded is not None
        return label_bag(reader, Raycaster(loaded), config, folder, also=("per_view",))


def live_poses(run: Path) -> dict[str, list[Any]]:
    """Poses published by the graph, in the order of stamps."""
    from tof_core.se3 import from_quat
    from tof_eval.runs import parts, read_run

    found = sorted((stamp, parts(message)["pose"]) for (stamp, topic), message in read_run(run).items() if topic.endswith("label/pose"))
    return {"graph, live": [from_quat(p[:3], p[3:]) for _, p in found]}


def _report(result: DemoResult, scene: Path) -> None:
    from toftwin.demo_report import write_report

    write_report(result, scene)


def summary(result: DemoResult) -> str:
    """The table that the command prints."""
    r = result.replayed
    return "\n".join(
        [
            f"over DDS: {r.report.sent} frames sent, {r.report.fates['kept']} kept, {r.report.lost} lost; the graph used {r.memory_bytes / 1e6:.0f} MB",
            depth_table(result.errors.rows),
            pose_table(result.errors.poses),
            f"labels within two of their sigmas of the truth: {result.errors.honest:.1%}",
            f"sweep of the paper with the camera of the default network, {result.comparison.result['views']} views against the truth:",
            methods_table(result.comparison.result["methods"]),
            "seconds: " + ", ".join(f"{name} {s:.0f}" for name, s in result.seconds.items()),
        ]
    )
