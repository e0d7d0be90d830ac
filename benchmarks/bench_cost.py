# SPDX-License-Identifier: Apache-2.0
"""What labels and filters cost beside libraries in the same run: processor time as a ratio, turn by turn, the error beside it."""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import tempfile
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks import librealsense
from benchmarks.bench_preproc import push_all
from benchmarks.figure import Figure, at_most
from benchmarks.recorded import Recorded, recorded
from benchmarks.tof_frames import captures, edge_rich, plane
from tof_core import se3
from tof_core.cores import ONE_THREAD
from tof_preproc.config import PreprocConfig
from tof_preproc.preprocessor import Preprocessor, warm_up

if TYPE_CHECKING:
    from collections.abc import Sequence

SCENE = "body_section"
SESSION = {"plan": {"views": 20, "stations": 4, "captures": 5}, "seed": 3}
EFFECTS = {"wiggling": 1.0, "amplitude_bias": 1.0, "multipath": 1.0}
ROUNDS = 2
"""Turn by turn, the least of each: neighbours on the host only add."""
FILTER_ROUNDS = 7


def run() -> list[Figure]:
    """Labels, then filters; a library that is not installed (`pip install toftwin[rivals]`) has no row."""
    return [*labels(), *filters()]


def labels() -> list[Figure]:
    """The whole commands `label` and `gap` over the poses of the same views by open3d and by small_gicp."""
    session = recorded(SCENE, SESSION, EFFECTS)
    rivals = [name for name in ("open3d", "small_gicp") if find_spec(name) is not None]
    ours, diagnosed, theirs = [], 0.0, {name: list[dict[str, Any]]() for name in rivals}
    with tempfile.TemporaryDirectory() as folder:
        for turn in range(ROUNDS + 1):  # the first fills Numba's cache and does not count
            out = Path(folder) / str(turn)
            ours.append(_command("label", session, out))
            if turn in (0, ROUNDS):  # A diagnosis takes as long as all others of a turn.
                diagnosed = _command("gap", session, out / "gap")
            for name in rivals:
                _, text = spent([sys.executable, "-m", "benchmarks.icp_rivals", str(session.bag), SCENE, name])
                theirs[name].append(json.loads(text.splitlines()[-1]))
        poses = json.loads((Path(folder) / str(ROUNDS) / "poses.json").read_text())
    error = off(session, [p["stamp_ns"] for p in poses], [p["T_cell_camera"] for p in poses])
    rows = [_ratio(session, name, min(ours[1:]), error, theirs[name]) for name in rivals]
    return [*rows, *(_diagnosis(diagnosed, theirs[name]) for name in rivals if name == "open3d")]


def filters() -> list[Figure]:
    """The same captures through our filters and through librealsense's chain, turn by turn; nothing where it is not installed."""
    if find_spec("pyrealsense2") is None:
        return []
    warm_up(plane().camera)
    sequence = captures(edge_rich(), 15, spikes=0.005, dropouts=0.02)
    frames, bars = librealsense.frames_of(sequence), {"default": 1.0, "paper": 1.5}
    seconds = {name: np.full(len(sequence), np.inf) for name in ("librealsense", *bars)}
    for _ in range(FILTER_ROUNDS):
        for name, least in seconds.items():
            took = (
                librealsense.filter_seconds(frames)
                if name == "librealsense"
                else push_all(Preprocessor(PreprocConfig(preset=name)), sequence)
            )
            np.minimum(least, took, out=least)
    ms = {name: 1e3 * float(np.median(least)) for name, least in seconds.items()}
    return [
        at_most(
            f"all filters of one 400x300 frame, {name}, over librealsense's threshold, spatial and temporal filter, processor time",
            ms[name] / ms["librealsense"], bar, "",
            remark=f"{ms[name]:.1f} ms against {ms['librealsense']:.1f} ms, medians of 15 captures, best of {FILTER_ROUNDS}; librealsense has no SOR "
                   "and keeps no captures of a dwell",
        )
        for name, bar in bars.items()
    ]  # fmt: skip


def _ratio(session: Recorded, name: str, ours: float, error: float, theirs: Sequence[dict[str, Any]]) -> Figure:
    peer = min(r["seconds"] for r in theirs)
    peer_error = off(session, theirs[-1]["stamps"], theirs[-1]["poses"])
    return at_most(
        f"processor time of label, 20 views 224x171, wiggling, amplitude bias and multipath on, over {name}'s point-to-plane ICP of each view",
        ours / peer, 1.0, "",
        remark=f"whole command {ours:.1f} s, poses off by {error:.2f} mm in the median; {name} {peer:.1f} s without reading and filtering, "
               f"{peer_error:.2f} mm",
    )  # fmt: skip


def _diagnosis(ours: float, theirs: Sequence[dict[str, Any]]) -> Figure:
    peer = min(r["seconds"] for r in theirs)
    return at_most(
        "processor time of gap, the same 20 views, over open3d's point-to-plane ICP of each view",
        ours / peer, 3.0, "",
        remark=f"whole command {ours:.1f} s, report included; open3d {peer:.1f} s without reading and filtering",
    )  # fmt: skip


def _command(name: str, session: Recorded, out: Path) -> float:
    """Processor seconds of a whole command on the session."""
    return spent([sys.executable, "-m", "toftwin.cli", name, str(session.bag), "--scene", SCENE, "--out", str(out), "--quiet"])[0]


def spent(command: Sequence[str]) -> tuple[float, str]:
    """Processor seconds of a command on one thread, and what it printed."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(command, env={**os.environ, **ONE_THREAD}, check=True, capture_output=True, text=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, done.stdout


def off(session: Recorded, stamps: Sequence[int], poses: Sequence[Any]) -> float:
    """Median millimetres between poses and the truth."""
    true = [session.truth["T_cell_camera"][int(np.argmin(np.abs(session.truth["stamp_ns"] - stamp)))] for stamp in stamps]
    return 1e3 * float(np.median([se3.distance(np.asarray(T), np.asarray(t, float))[0] for T, t in zip(poses, true, strict=True)]))
