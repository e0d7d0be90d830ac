# SPDX-License-Identifier: Apache-2.0
"""The graph over DDS: outputs against offline, frames lost at 15 Hz, memory; idle, killed, and seen by a late joiner."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks import live_graph
from benchmarks.figure import Figure, at_most
from benchmarks.offline import graph_outputs
from tof_core.se3 import from_quat
from tof_eval.runs import parts, read_run
from tof_ros.player import PlayOptions
from tof_scene.raycast import Raycaster
from toftwin import cli
from toftwin.inputs import opened
from toftwin.pipeline import PipelineConfig
from toftwin.replay import ReplayResult, replay

if TYPE_CHECKING:
    from benchmarks.offline import Output

SCENE = Path("body_section")


def run() -> list[Figure]:
    """Record 300 captures at 15 Hz, replay them as fast as the graph takes them, then in real time."""
    with tempfile.TemporaryDirectory() as folder:
        bag, out = Path(folder) / "bag", Path(folder) / "run"
        recorded = cli.main(
            [
                "simulate",
                "--scene",
                "body_section",
                "--out",
                str(bag),
                "--views",
                "20",
                "--stations",
                "4",
                "--captures",
                "15",
                "--size",
                "224x171",
                "--seed",
                "2",
                "--quiet",
            ]
        )
        assert recorded == 0
        paced = play(bag, PlayOptions(), record=out)
        differing, largest, compared = against_offline(bag, out)
        live = play(bag, PlayOptions(realtime=True))
    lost = f"of {paced.report.sent}, {paced.report.sent / paced.report.seconds:.1f} frames/s"
    return [
        at_most(
            "replay over DDS against offline, images of preproc and masks that differ in any bit", differing, 0, "", remark=f"of {compared}"
        ),
        at_most(
            "replay over DDS against offline, label depth, sigma and pose",
            largest * 1e3,
            1e-3,
            "mm",
            remark="float32's last bit: sums over arrays that lie elsewhere in memory",
        ),
        at_most("frames lost in a replay over DDS", paced.report.lost, 0, "", remark=lost),
        at_most("frames lost in real time, 300 at 15 Hz", live.report.lost, 0, "", remark=f"of {live.report.sent}, 224x171"),
        Figure(
            "processor time of the graph for a 224x171 frame, labels and its start included",
            1e3 * paced.cpu_s / paced.report.sent,
            "ms",
            remark="two cores have 133 ms at 15 Hz",
        ),
        at_most("memory of the whole graph (preproc, sim_label)", paced.memory_bytes / 1e9, 1.5, "GB"),
        *live_graph.figures(),
    ]


def play(bag: Path, options: PlayOptions, record: Path | None = None) -> ReplayResult:
    """Replay a bag through a graph of its own."""
    config = PipelineConfig()
    with opened(bag, SCENE, config) as (reader, _):
        return replay(reader, config, scene=SCENE, options=options, record=record)


def against_offline(bag: Path, run_path: Path) -> tuple[int, float, int]:
    """Images of preproc and masks that differ in any bit, the largest difference of labels in metres, images compared."""
    recorded, config = read_run(run_path), PipelineConfig()
    differing, largest, compared = 0, 0.0, 0
    with opened(bag, SCENE, config) as (reader, scene):
        assert scene is not None
        for output in graph_outputs(reader, config, Raycaster(scene)):
            message = recorded.pop((output.stamp_ns, output.topic), None)
            compared += 1
            if message is None:
                differing += 1
            elif output.topic in ("/label/pose", "/label/depth", "/label/sigma"):
                largest = max(largest, _distance(message, output))
            else:
                values = parts(message)["pixels"]
                differing += not np.array_equal(values, output.values, equal_nan=values.dtype.kind == "f")
    return differing, largest, compared


def _distance(message: Any, output: Output) -> float:
    """The largest difference in metres; infinite where one has a pixel that the other lacks."""
    found = parts(message)
    if "pose" in found:
        return float(np.abs(from_quat(found["pose"][:3], found["pose"][3:]).ravel() - output.values[:16]).max())
    a, b = found["pixels"], output.values
    return float(np.nanmax(np.abs(a - b))) if np.array_equal(np.isnan(a), np.isnan(b)) else float("inf")
