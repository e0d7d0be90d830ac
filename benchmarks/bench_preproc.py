# SPDX-License-Identifier: Apache-2.0
"""Filters: how fast against Open3D in the same run, how equal to the k-d tree's, how honest, how much better."""

from __future__ import annotations

import os
import time
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.figure import Figure, at_least, at_most
from benchmarks.tof_frames import captures, edge_rich, plane
from tof_core.reasons import Reason
from tof_preproc.config import PreprocConfig, SorConfig
from tof_preproc.frame import Frame
from tof_preproc.preprocessor import Preprocessor, accumulate_views, warm_up
from tof_preproc.sor import remove_sor

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from tof_core.arrays import Bytes, Mask
    from tof_core.capture import Capture

ROUNDS = 7
PAPER_SOR = PreprocConfig(sor=SorConfig(method="paper"))


def run() -> list[Figure]:
    """All figures; frames are 400x300."""
    warm_up(plane().camera)
    return [*statistical_outliers(), *all_filters(), *accumulation(), flying()]


def frames() -> dict[str, Capture]:
    """Clean, noisy and edge-rich frames of 120 000 points, and one with spikes and holes besides."""
    return {
        "clean": captures(plane(), noise=0.0)[0],
        "noisy": captures(plane(), noise=5.0)[0],
        "edge-rich": captures(edge_rich())[0],
        "edge-rich, 1 % spikes, 5 % holes": captures(edge_rich(), spikes=0.01, dropouts=0.05)[0],
    }


def statistical_outliers() -> list[Figure]:
    """Speed and equality of `paper` SOR (20 neighbours, 2 sigma), frame by frame."""
    figures = []
    for name, capture in frames().items():
        ours, theirs, seconds, peer_seconds = against_open3d(capture)
        both = np.count_nonzero(ours & theirs)
        f1 = 2 * both / (1e-9 + np.count_nonzero(ours) + np.count_nonzero(theirs))
        remark = f"{seconds * 1e3:.1f} ms against {peer_seconds * 1e3:.1f} ms, best of {ROUNDS} each"
        figures += [
            at_least(
                f"SOR on one core, times faster than open3d on {len(os.sched_getaffinity(0))}: {name}",
                peer_seconds / seconds,
                3,
                "",
                remark=remark,
            ),
            at_least(
                f"SOR, F1 on removed pixels against open3d's k-d tree: {name}",
                f1,
                0.95,
                "",
                remark=f"{np.count_nonzero(theirs)} pixels removed there",
            ),
        ]
    return figures


def against_open3d(capture: Capture) -> tuple[Mask, Mask, float, float]:
    """Pixels (H, W) that ours and Open3D's remove, and the least seconds of each; turn and turn about."""
    import open3d as o3d

    points = capture.camera.points(capture.depth).reshape(-1, 3)
    known = np.flatnonzero(np.isfinite(points[:, 2]))
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points[known]))
    ours = theirs = np.zeros(0, bool)
    seconds, peer_seconds = [], []
    for _ in range(ROUNDS):
        with one_core():
            elapsed, ours = timed(lambda: filtered(capture) == Reason.SOR)
        seconds.append(elapsed)
        elapsed, (_, kept) = timed(lambda: cloud.remove_statistical_outlier(20, 2.0))
        peer_seconds.append(elapsed)
        theirs = np.zeros(capture.depth.size, bool)
        theirs[known] = True
        theirs[known[np.asarray(kept)]] = False
    return ours, theirs.reshape(ours.shape), min(seconds), min(peer_seconds)


def filtered(capture: Capture) -> Bytes:
    """Reasons (H, W) after SOR alone."""
    frame = Frame(capture.camera, capture.depth.copy(), capture.reason.copy(), np.ones_like(capture.depth))
    remove_sor(frame, PAPER_SOR)
    return frame.reason


def all_filters() -> list[Figure]:
    """Time of one push, with everything on: the first capture of a dwell and its fifteenth."""
    sequence = captures(edge_rich(), 15, spikes=0.005, dropouts=0.02)
    figures = []
    for preset in ("default", "paper"):
        rounds = np.array([push_all(Preprocessor(PreprocConfig(preset=preset)), sequence) for _ in range(ROUNDS)]).min(axis=0) * 1e3
        what = f"all filters of one 400x300 frame, one core, {preset}"
        remark = f"processor time of one thread, edge-rich with 0.5 % spikes, best of {ROUNDS}"
        figures += [
            at_most(f"{what}: first capture of a dwell", float(rounds[0]), 50, "ms", remark=remark),
            at_most(f"{what}: slowest of 15 captures of a dwell", float(rounds.max()), 50, "ms", remark=remark),
        ]
    return figures


def push_all(preprocessor: Preprocessor, sequence: list[Capture]) -> list[float]:
    """Processor seconds of each push."""
    seconds = []
    with one_core():
        for capture in sequence:
            started = time.thread_time()
            preprocessor.push(capture)
            seconds.append(time.thread_time() - started)
    return seconds


def accumulation() -> list[Figure]:
    """Error of ten captures with 2 % spikes, and whether sigma says it."""
    truth = plane()
    error, score = {}, {}
    for preset in ("default", "paper"):
        (view,) = accumulate_views(captures(truth, 10, spikes=0.02), PreprocConfig(preset=preset))
        off = (view.depth - truth.depth)[view.valid]
        error[preset], score[preset] = float(np.sqrt(np.mean(off**2))) * 1e3, float(np.mean(np.abs(off) < 2 * view.sigma[view.valid]))
    what = "ten captures of a plane with 2 % spikes"
    return [
        Figure(f"{what}: RMS error, default", error["default"], "mm", remark=f"paper {error['paper']:.3g} mm"),
        Figure(
            f"{what}: errors within 2 sigma (normal: 95.4), default",
            100 * score["default"],
            "%",
            remark=f"paper {100 * score['paper']:.3g} %",
        ),
    ]


def flying() -> Figure:
    """Mixed pixels found on an edge-rich frame of ten captures, and clean ones lost."""
    truth = edge_rich()
    (view,) = accumulate_views(captures(truth, 10))
    off = np.abs(truth.depth - truth.surface)
    lost = float((~view.valid)[off < 1e-3].mean())
    return Figure(
        "mixed pixels more than 10 mm off every surface, removed",
        100 * float((~view.valid)[off > 0.01].mean()),
        "%",
        remark=f"{100 * lost:.2g} % of pixels within 1 mm of their surface lost",
    )


def timed(call: Callable[[], Any]) -> tuple[float, Any]:
    """Seconds and result."""
    started = time.perf_counter()
    result = call()
    return time.perf_counter() - started, result


@contextmanager
def one_core() -> Iterator[None]:
    """Hold this thread to one core."""
    cores = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(cores)})
    try:
        yield
    finally:
        os.sched_setaffinity(0, cores)
