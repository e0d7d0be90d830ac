# SPDX-License-Identifier: Apache-2.0
"""Real captures and foreign bags: a room fitted once and met again, radial depth refused, two cases labelled."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.figure import Figure, at_most
from benchmarks.primitive_scene import primitive_scene
from benchmarks.primitives import PrimitiveConfig, Sphere, fit_primitives
from tof_align.single import align_view
from tof_core import se3
from tof_core.bag import BagOptions, open_bag
from tof_core.capture import View
from tof_core.errors import RefusedError
from tof_core.motion import StationTracker
from tof_scene.raycast import Raycaster
from tof_scene.scene_file import load_scene
from tof_sim_label.gate import RadialGate
from tof_sim_label.label import label_view
from tof_sim_label.labeller import label_session

if TYPE_CHECKING:
    from tof_core.arrays import Float

DATA = Path(__file__).resolve().parents[2] / "shared" / "data"
ROUGH = se3.exp([0.02, -0.015, 0.02, 0.015, -0.01, 0.01])
"""Start of the alignment: 32 mm and 1.2 degrees off."""


def run() -> list[Figure]:
    """Every figure that real data give; none where they are not beside the checkout."""
    if not DATA.is_dir():
        return [Figure("real captures", float("nan"), "", remark="skipped: no ../shared/data beside the checkout")]
    return [*room(), *radial(), *cases()]


def views_of(bag: Path, depth: str = "z") -> list[View]:
    """Every capture of a bag without TF as a view."""
    with open_bag(bag, BagOptions(depth=depth)) as reader:
        return [View.of_capture(c) for c in reader.captures(need_tf=False)]


def room() -> list[Figure]:
    """Fit planes and spheres to one Azure Kinect frame, and align the other frame of the pair to them."""
    first, other = views_of(DATA / "real/azure_kinect_static/bag")
    config = PrimitiveConfig()
    found = fit_primitives(first.depth, first.camera, config)
    balls = [f.surface.radius for f in found if isinstance(f.surface, Sphere)]
    caster = Raycaster(primitive_scene(found, first.camera, config.stride))
    aligned = align_view(other, caster, ROUGH, None)
    metres, degrees = se3.distance(aligned.posed.T_cell_camera, np.eye(4))
    label = label_view(other, aligned.posed, caster)
    used = (label.mask == 1) & np.isfinite(other.depth)
    error = 1e3 * (other.depth - label.depth)[used]
    sizes = ", ".join(f"{2e3 * radius:.1f}" for radius in balls)
    words = f"{len(found) - len(balls)} planes, {len(balls)} spheres of {sizes} mm"
    return [
        Figure("Azure Kinect pair: the other frame's pose against standing still", 1e3 * metres, "mm",
               remark=f"{degrees:.3f} deg, from 32 mm and 1.2 deg off; {words}"),
        Figure("Azure Kinect pair: MAE of the other frame against its label", float(np.abs(error).mean()), "mm",
               remark=f"median {np.median(np.abs(error)):.2f} mm, bias {error.mean():+.2f} mm, {100 * used.mean():.0f} % of the image"),
    ]  # fmt: skip


def radial() -> list[Figure]:
    """The ifm O3R frame declared as z, and as what it is."""
    bag = DATA / "real/ifm_o3r/bag_radial"
    as_z, why = gate(bag, "z")
    as_radial, other = gate(bag, "radial")
    return [at_most("ifm O3R radial bag: wrong answers when declared z and when declared radial", float(as_z) + float(not as_radial), 0.0, "",
                    remark=(why or "taken for z") + (f"; {other}" if other else "; passes as radial"))]  # fmt: skip


def gate(bag: Path, depth: str) -> tuple[bool, str]:
    """Whether a bag passes as that kind of depth, and why not."""
    try:
        RadialGate().check(views_of(bag, depth)[0])
    except RefusedError as error:
        return False, error.what
    return True, ""


def cases() -> list[Figure]:
    """Both bags of a camera that is in no other place here."""
    figures = []
    for name in ("example_null", "example_wiggling"):
        scene = load_scene(DATA / "cases" / name / "scene" / "scene.yaml")
        tracker, views = StationTracker(), list[View]()
        with open_bag(DATA / "cases" / name / "bag", cell_frame=scene.frame) as reader:
            for capture in reader.captures():
                base: Float = np.eye(4) if capture.robot is None else capture.robot.T_cell_body
                views.append(View.of_capture(capture, tracker.push(base)))
        solution, labels = label_session(views, Raycaster(scene))
        errors = [(v.depth - label.depth)[(label.mask == 1) & np.isfinite(v.depth)] for v, label in labels]
        pooled = 1e3 * np.concatenate(errors)
        refused = sum(not p.accepted for p in solution.posed)
        figures.append(at_most(f"{name}: views without a label, of {len(views)}", refused, 0, "",
                               remark=f"measured against label: MAE {np.abs(pooled).mean():.2f} mm, bias {pooled.mean():+.2f} mm"))  # fmt: skip
    return figures
