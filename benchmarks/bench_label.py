# SPDX-License-Identifier: Apache-2.0
"""Labels: how fast, how true, how honest about it; and what keeping a frame costs."""

from __future__ import annotations

import shutil
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.figure import Figure, at_least, at_most
from benchmarks.recorded import Recorded, recorded, recorded_in
from tof_align.config import AlignConfig
from tof_align.session import solve_session
from tof_core import se3
from tof_core.capture import Capture, Posed
from tof_scene.builtin import builtin_names
from tof_scene.raycast import Raycaster
from tof_scene.scene import Part, Scene
from tof_sim_label.config import LabelConfig
from tof_sim_label.dataset import Dataset, DatasetWriter
from tof_sim_label.label import Label, label_view
from tof_sim_label.labeller import label_session
from tof_sim_label.schema import Attributes

if TYPE_CHECKING:
    from collections.abc import Callable

    from tof_align.session import SessionSolution
    from tof_core.arrays import Float

SESSION = {"plan": {"views": 20, "stations": 4}, "seed": 3}
"""Twenty views at 224 x 171, four stations, the arm's error as designed."""
UNMODELLED = {"wiggling": 1.0, "amplitude_bias": 1.0, "multipath": 1.0}
POSE_COV = np.diag(np.repeat([0.15e-3, np.radians(0.02)], 3)) ** 2


@dataclass(frozen=True, slots=True, eq=False)
class Labelled:
    """Label errors of a session, pixel by pixel, and the sigma each label gave itself (metres)."""

    solution: SessionSolution
    error: Float
    sigma: Float
    pose_mm: float
    pose_deg: float
    masked: float
    """Share of the pixels on the CAD that the mask leaves out."""

    @property
    def mae_mm(self) -> float:
        """Mean absolute label error."""
        return 1e3 * float(np.abs(self.error).mean())

    def within(self, sigmas: float) -> float:
        """Per cent of label errors within so many of their own sigmas."""
        return 100.0 * float((np.abs(self.error) <= sigmas * self.sigma).mean())


def run() -> list[Figure]:
    """Every figure of this room."""
    return [*speed(), *truth(), *cloud(), *honesty(), *unseen(), *keeping()]


def speed() -> list[Figure]:
    """Labels of 400 x 300 at a given pose."""
    session = recorded("body_section", {"camera": {"width": 400, "height": 300}, "plan": {"views": 8, "stations": 2}, "seed": 1})
    caster, views = Raycaster(session.scene), session.views()
    poses = [Posed(T, POSE_COV) for T in session.truth["T_cell_camera"]]

    def once(i: int) -> Label:
        return label_view(views[i % len(views)], poses[i % len(views)], caster)

    once(0)
    before = time.process_time()
    one = per_second(lambda: [once(i) for i in range(16)], 16)
    busy = (time.process_time() - before) / 48
    with ThreadPoolExecutor(2) as pool:
        both = per_second(lambda: list(pool.map(once, range(16))), 16)
    remark = f"{one:.1f} on one thread; {1e3 * busy:.0f} ms of processor time each ({caster.backend})"
    return [at_least("labels of 400x300 views, pose given, both cores", both, 5.0, "1/s", remark=remark)]


def per_second(work: Callable[[], object], count: int) -> float:
    """Best rate of three runs."""
    best = 0.0
    for _ in range(3):
        started = time.perf_counter()
        work()
        best = max(best, count / (time.perf_counter() - started))
    return best


def labelled(session: Recorded, align: AlignConfig, label: LabelConfig | None = None) -> Labelled:
    """Solve and label a session and compare with its truth."""
    caster, views = Raycaster(session.scene), session.views()
    solution = solve_session(views, caster, align)
    errors, sigmas, off, masked = [], [], [], []
    for view, posed, true, T in zip(views, solution.posed, session.truth["depth"], session.truth["T_cell_camera"], strict=True):
        made = label_view(view, posed, caster, label)
        used = (made.mask == 1) & np.isfinite(true)
        errors.append((made.depth - true)[used])
        sigmas.append(made.sigma[used])
        masked.append(1.0 - used.sum() / (np.isfinite(made.depth) & np.isfinite(true)).sum())
        off.append(se3.distance(posed.T_cell_camera, T))
    metres, degrees = np.median(off, axis=0)
    error, sigma = np.concatenate(errors).astype(float), np.concatenate(sigmas).astype(float)
    return Labelled(solution, error, sigma, 1e3 * metres, degrees, float(np.mean(masked)))


def truth() -> list[Figure]:
    """Label error of a session with photon noise alone."""
    result = labelled(recorded("body_section", SESSION), AlignConfig())
    return [
        at_most(
            "label MAE, session of 20 views, noise only",
            result.mae_mm,
            0.2,
            "mm",
            remark=f"median pose off by {result.pose_mm:.3f} mm, {result.pose_deg:.4f} deg; {100 * result.masked:.1f} % of the CAD's pixels masked",
        )
    ]


def cloud() -> list[Figure]:
    """One session by its depth images and by its point clouds: filtered, aligned and labelled each for itself."""
    from tof_core.bag import BagOptions, open_bag
    from toftwin.pipeline import PipelineConfig, ViewStream

    plan = {"plan": {"views": 6, "stations": 2, "captures": 4}, "output": {"points": True, "encoding": "32FC1"}, "seed": 6}
    session = recorded("body_section", plan)
    made = []
    for options in (BagOptions(depth_topic="/depth/hand/image"), BagOptions(points_topic="/depth/hand/points")):
        with open_bag(session.bag, options, cell_frame=session.scene.frame) as reader:
            made.append([label for _, label in label_session(list(ViewStream(reader, PipelineConfig())), Raycaster(session.scene))[1]])
    apart = np.concatenate([1e3 * np.abs(a.depth - b.depth)[(a.mask == 1) & (b.mask == 1)] for a, b in zip(*made, strict=True)])
    moved = max(1e3 * se3.distance(a.posed.T_cell_camera, b.posed.T_cell_camera)[0] for a, b in zip(*made, strict=True))
    remark = f"{apart.size} pixels of {len(made[0])} views, depth as 32FC1; poses apart by {moved:.2g} mm at most"
    return [
        at_most("labels of the same views by PointCloud2 and by Image, largest difference", float(apart.max()), 0.1, "mm", remark=remark)
    ]


def honesty() -> list[Figure]:
    """Whether labels know how wrong they are when the sensor does what nobody modelled."""
    return [figure for name in builtin_names() for figure in _honesty(name)]


def _honesty(name: str) -> list[Figure]:
    session = recorded(name, SESSION, UNMODELLED)
    whole = labelled(session, AlignConfig())
    bare = labelled(session, AlignConfig(), LabelConfig(unseen_offset_mm=0.0))
    icp = labelled(session, AlignConfig(mode="per_view"))
    moved = np.abs(se3.log(whole.solution.X)) / AlignConfig().priors.hand_eye
    what = f"{name}, wiggling, amplitude bias and multipath on, none modelled"
    sigma, alone = 1e3 * float(np.median(whole.sigma)), 1e3 * float(np.median(bare.sigma))
    honest = f"median sigma {sigma:.2f} mm; without its 2 mm of unseen offset {bare.within(2):.1f} % at {alone:.2f} mm"
    return [
        at_least(f"label errors within 2 sigma: {what}", whole.within(2), 90.0, "%", remark=honest),
        at_most(f"label MAE over per-view ICP's: {what}", whole.mae_mm / icp.mae_mm, 1.0, "",
                remark=f"session {whole.mae_mm:.2f} mm, per-view ICP {icp.mae_mm:.2f} mm"),
        at_most(f"hand-eye moved: {what}", float(moved.max()), 3.0, "prior sigmas"),
    ]  # fmt: skip


def unseen() -> list[Figure]:
    """A constant range offset of the usual strength, which one-sided views of a panel do not tell from its place."""
    plan = {"plan": {"views": 8, "stations": 2, "azimuth_deg": 20.0, "elevation_max_deg": 15.0}, "seed": 4}
    session = recorded_in("panel", panel(), plan, {"range_offset": 1.0})
    whole, bare = labelled(session, AlignConfig()), labelled(session, AlignConfig(), LabelConfig(unseen_offset_mm=0.0))
    return [at_least("label errors within 2 sigma: a panel from one side, constant range offset of 3 mm", whole.within(2), 90.0, "%",
                     remark=f"MAE {whole.mae_mm:.2f} mm, within 1 sigma {whole.within(1):.0f} %; without the 2 mm of unseen offset "
                            f"{bare.within(2):.0f} % within 2 sigma")]  # fmt: skip


def panel() -> Scene:
    """A flat sheet with one rib."""
    import trimesh

    parts = []
    for name, size, at in (("sheet", (0.01, 0.6, 0.5), (0.0, 0.0, 0.8)), ("rib", (0.04, 0.03, 0.4), (0.02, 0.1, 0.8))):
        box = trimesh.creation.box(size)
        parts.append(Part(name, np.asarray(box.vertices) + np.array(at), np.asarray(box.faces, np.int32)))
    return Scene("cell", tuple(parts))


def keeping() -> list[Figure]:
    """What appending one 400 x 300 frame costs, on disk when it returns."""
    rng = np.random.default_rng(0)
    session = recorded("body_section", {"camera": {"width": 400, "height": 300}, "plan": {"views": 8, "stations": 2}, "seed": 1})
    view, caster = session.views()[0], Raycaster(session.scene)
    noisy = (view.depth + rng.normal(scale=2e-3, size=view.depth.shape)).astype(np.float32)
    label = label_view(view, Posed(session.truth["T_cell_camera"][0], POSE_COV), caster)
    capture = Capture(1, view.camera, noisy, view.reason, amplitude=view.amplitude)
    folder = Path(tempfile.mkdtemp(dir=session.bag.parent))
    try:
        with DatasetWriter(folder / "d", view.camera, Attributes("c", "c", "bench", session.scene.names)) as writer:
            one = 1e3 / per_second(lambda: [writer.append_capture(capture) for _ in range(30)], 30)
            whole = 1e3 / per_second(lambda: [writer.append_view(replace(view, depth=noisy), label) for _ in range(15)], 15)
        size = sum(f.stat().st_size for f in folder.rglob("*") if f.is_file())
        data = Dataset(folder / "d")
        read = 1e3 / per_second(lambda: [data.frame("captures/raw", i) for i in range(30)], 30)
        return [
            Figure("appending one 400x300 capture to the dataset, synced", one, "ms", remark=f"reading one frame {read:.1f} ms"),
            Figure(
                "appending one 400x300 view with its label, synced",
                whole,
                "ms",
                remark=f"{size / 1e6 / (data.captures + data.views):.2f} MB a frame",
            ),
        ]
    finally:
        shutil.rmtree(folder)
