# SPDX-License-Identifier: Apache-2.0
"""report.html of the demonstration: pictures and figures."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from tof_core.page import render_page
from tof_core.panels import panels
from tof_core.reasons import Reason
from tof_eval import pictures
from tof_eval.report import sweep_plot, view_picture
from tof_eval.words import called
from tof_scene.raycast import Raycaster
from tof_scene.render import render
from tof_scene.scene_file import load_scene
from tof_sim_label.dataset import open_dataset
from tof_virtual.truth import load_truth

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from tof_sim_label.dataset import Dataset
    from toftwin.demo.result import DemoResult

GALLERY = 12


def write_report(result: DemoResult, scene: Path) -> Path:
    """Write `report.html` into the demo's folder."""
    dataset, (truth, meta) = open_dataset(result.folder / "dataset.zarr"), load_truth(result.folder / "truth")
    caster = Raycaster(load_scene(scene))
    view = _fullest_view(dataset)
    html = render_page(
        "toftwin",
        "demo.html.j2",
        "toftwin: a camera and its twin",
        sentence=sentence(result),
        four=_four(result),
        config=result.config,
        rows=result.errors.rows,
        poses=[_pose_row(p) for p in result.errors.poses],
        honest=result.errors.honest,
        spent=result.spent,
        called=called,
        replayed=result.replayed,
        labelled=result.labelled,
        effects=meta["effects"],
        view=view,
        scene_names=caster.scene.names,
        backend=caster.backend,
        camera=dataset.camera,
        hero=hero(dataset, truth, caster, view),
        pose_plot=pictures.pose_plot(result.errors.poses),
        histogram=_histogram(dataset, truth),
        reasons=_reasons(result.folder / "graph"),
        methods=result.comparison.result["methods"],
        sweep=sweep_plot(result.comparison.result["methods"]),
        repaired=view_picture(*result.comparison.shown),
        gallery=_gallery(dataset, truth),
        stations=sorted(set(dataset.column("views/station").tolist())),
    )
    path = result.folder / "report.html"
    path.write_text(html, encoding="utf-8")
    return path


def sentence(result: DemoResult) -> str:
    """The four results in words."""
    gone, moved = result.inspected.truth.gone, result.inspected.truth.moved
    right, of, every = result.inspected.right, result.inspected.judged, len(result.inspected.verdicts)
    before, after = result.corrected.before[0], result.corrected.after[0]
    parts = f"All {of} observable parts" if of < every else f"All {of} parts"
    parts = f"{parts} were judged rightly" if right == of else f"{right} of {of} judged parts were judged rightly"
    return (
        f"The labels are {1e3 * result.errors.rows[4][1].mae:.2f} mm off in the mean. The gap between camera and simulation fell from "
        f"{result.diagnosed.before_mm:.1f} to {result.diagnosed.after_mm:.1f} mm. A day later the hand stood {before:.0f} mm beside its place; the correction left "
        f"{after:.1f} mm. {parts}{f', among them {gone}, which is absent, and {moved}, which is displaced' if gone else ''}."
    )


def _four(result: DemoResult) -> dict[str, Any]:
    """The content of the first four sections."""
    corrected, replaced, inspected = result.corrected, result.replaced, result.inspected
    proposal = corrected.made["reference"]
    shown = int(np.argmax(np.isfinite(replaced.ideal).sum(axis=(1, 2))))
    verdicts = sorted(inspected.verdicts, key=lambda v: (v.state == "present", v.name))
    return {
        "gap": result.diagnosed,
        "causes": [c["effect"].replace("_", " ") for c in result.diagnosed.content["causes"]],
        "words": [w["sentence"] for w in result.diagnosed.content["words"]],
        "correct": corrected,
        "proposal": proposal,
        "step": proposal.step,
        "correct_picture": panels(
            [
                ("a day later: minus the first day", corrected.now - corrected.reference, "error"),
                ("after the last move: minus the first day", corrected.then - corrected.reference, "error"),
            ],
            columns=2,
            span_mm=20.0,
            width=11.0,
        ),
        "inspect": inspected,
        "verdicts": verdicts,
        "replace": replaced,
        "replace_picture": panels(
            [
                ("camera minus simulation with an ideal camera", replaced.ideal[shown], "error"),
                ("camera minus simulation with the fitted sensor", replaced.by_fitted[shown], "error"),
            ],
            columns=2,
            width=11.0,
        ),
        "replace_histogram": pictures.error_histogram(
            [("ideal camera", _sample(replaced.ideal)), ("fitted sensor", _sample(replaced.by_fitted))],
            xlabel="camera minus simulation, mm",
            band_mm=replaced.noise_mm,
        ),
        "view": shown,
    }


def _sample(difference_m: NDArray[Any]) -> NDArray[Any]:
    return np.asarray(1e3 * difference_m[np.isfinite(difference_m)])


def _fullest_view(dataset: Dataset) -> int:
    """The view whose label covers most parts."""
    return int(np.argmax([len(np.unique(dataset.frame("views/part", v))) for v in range(dataset.views)]))


def _pose_row(pose: Any) -> dict[str, Any]:
    return {
        "name": pose.name,
        "mm": float(np.median(pose.millimetres)),
        "mm_max": float(pose.millimetres.max()),
        "deg": float(np.median(pose.degrees)),
        "deg_max": float(pose.degrees.max()),
    }


def hero(dataset: Dataset, truth: dict[str, Any], caster: Raycaster, v: int) -> str:
    """One view from raw to label, and its errors before and after."""
    raw = _raw(dataset, v)
    depth, label, part = (dataset.frame(f"views/{n}", v) for n in ("depth", "label", "part"))
    true, robot = truth["depth"][v], render(caster, dataset.camera, truth["T_robot"][v], footprints=False).depth
    return panels(
        [
            ("raw, one capture", raw, "depth"),
            ("accumulated and filtered", depth, "depth"),
            ("label: CAD at the solved pose", label, "depth"),
            ("its parts", part, "part"),
            ("before: minus CAD at the robot's pose", depth - robot, "error"),
            ("after: minus label (CAD at the solved pose)", depth - label, "error"),
            ("filtered minus truth", depth - true, "error"),
            ("label minus truth", label - true, "error"),
        ],
        columns=4,
        width=13.5,
    )


def _raw(dataset: Dataset, v: int) -> NDArray[Any]:
    return dataset.frame("captures/raw", int(np.flatnonzero(dataset.column("captures/view") == v)[-1]))


def _histogram(dataset: Dataset, truth: dict[str, Any]) -> str:
    raw = np.concatenate([_errors(_raw(dataset, v), truth["depth"][v]) for v in range(dataset.views)])
    filtered = np.concatenate([_errors(dataset.frame("views/depth", v), truth["depth"][v]) for v in range(dataset.views)])
    return pictures.error_histogram([("raw", raw), ("filtered", filtered)])


def _errors(measured: NDArray[Any], true: NDArray[Any]) -> NDArray[Any]:
    errors = (measured - true)[np.isfinite(measured) & np.isfinite(true)] * 1e3
    return np.asarray(errors[np.abs(errors) < 50])


def _reasons(run: Path) -> str:
    """Why pixels have no depth, over all running views of the graph."""
    from tof_core.decode import pixels
    from tof_eval.runs import read_run

    counts = np.zeros(256, np.int64)
    for (_, topic), message in read_run(run).items():
        if topic.endswith("preproc/reason"):
            counts += np.bincount(pixels(message).ravel(), minlength=256)
    named = [
        (r.name.lower().replace("_", " "), 100.0 * counts[r] / max(counts.sum(), 1)) for r in Reason if r != Reason.VALID and counts[r]
    ]
    return pictures.bars(named, "share of all pixels, %")


def _gallery(dataset: Dataset, truth: dict[str, Any]) -> str:
    chosen = np.unique(np.linspace(0, dataset.views - 1, min(GALLERY, dataset.views)).round().astype(int))
    stations = dataset.column("views/station")
    images = [(f"view {v}, station {stations[v]}", dataset.frame("views/depth", int(v)) - truth["depth"][v], "error") for v in chosen]
    return panels(images, columns=4, width=13.5)
