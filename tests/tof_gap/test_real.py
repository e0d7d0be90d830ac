# SPDX-License-Identifier: Apache-2.0
"""Real captures and foreign sessions: what is grafted onto them is named, what they are by themselves is not."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from benchmarks.primitive_scene import primitive_scene
from benchmarks.primitives import PrimitiveConfig, fit_primitives
from tof_align.config import AlignConfig
from tof_core import se3
from tof_core.bag import BagOptions, open_bag
from tof_core.capture import Capture, RobotPose, View
from tof_core.config import from_mapping
from tof_gap.config import GapConfig
from tof_gap.diagnose import diagnose
from tof_scene.raycast import Raycaster
from tof_scene.render import render
from tof_scene.scene_file import save_scene
from toftwin.cli import main

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from tof_core.arrays import Float
    from tof_gap.tell.diagnosis import Diagnosis

pytestmark = pytest.mark.shared
STEP = 4
"""Every STEP-th pixel of the real frame is a view of its own: nine of the sixteen, each with its own noise."""


def frame_of(bag: Path, depth: str = "z") -> Capture:
    with open_bag(bag, BagOptions(depth=depth)) as reader:
        return next(iter(reader.captures(need_tf=False)))


def thinned(frame: Capture, row: int, column: int, graft: Callable[[Float], Float]) -> View:
    """One of the interleaved views: the camera turned by the fraction of a pixel by which its raster is shifted."""
    c = frame.camera
    h, w = c.height // STEP, c.width // STEP
    camera = replace(c, width=w, height=h, fx=c.fx / STEP, fy=c.fy / STEP, cx=c.cx / STEP, cy=c.cy / STEP)
    at = (slice(row, row + h * STEP, STEP), slice(column, column + w * STEP, STEP))
    length = camera.ray_length()
    depth = frame.depth[at] + graft(frame.depth[at] * length) / length
    turned = se3.exp([0, 0, 0, -row / c.fy, column / c.fx, 0])
    assert frame.amplitude is not None
    return View.of_capture(
        replace(
            frame,
            stamp_ns=frame.stamp_ns + 1_000_000 * (row * STEP + column),
            camera=camera,
            depth=depth.astype(np.float32),
            reason=frame.reason[at],
            amplitude=frame.amplitude[at],
            robot=RobotPose(np.eye(4), turned),
        )
    )


def without_own_gap(frame: Capture, caster: Raycaster) -> Capture:
    """The frame less the smooth part of its own residual: what is left of the real frame is scatter, the null."""
    residual = frame.depth - render(caster, frame.camera, np.eye(4), footprints=False).depth
    near = np.abs(residual) < 0.03
    smooth = gaussian_filter(np.where(near, residual, 0.0), 5.0) / np.maximum(gaussian_filter(near.astype(float), 5.0), 1e-6)
    return replace(frame, depth=np.where(near, frame.depth - smooth, np.nan).astype(np.float32))


def diagnosed(frame: Capture, caster: Raycaster, graft: Callable[[Float], Float]) -> Diagnosis:
    """The real frame with something grafted onto its ranges; the room was fitted to it, so its camera is known but for what the fit lacks."""
    views = [thinned(frame, r, c, graft) for r in (0, 1, 3) for c in (0, 1, 3)]
    return diagnose(views, caster, GapConfig(), from_mapping(AlignConfig, {"priors.base_mm": 1.0, "priors.base_deg": 0.1}))


def explained_by(d: Diagnosis, name: str) -> float:
    """Share of the gap that an effect alone takes off the held-out views; 0 where it is not named."""
    return max((c.alone.shrink or 0.0 for c in d.causes if c.named.name == name), default=0.0)


def above_floor(d: Diagnosis) -> float:
    """Millimetres of gap beyond scatter and pose."""
    return float(np.sqrt(max(d.gap.before.rmse**2 - d.gap.floor_mm**2, 0.0)))


@pytest.mark.slow
def test_an_effect_grafted_onto_a_real_frame_is_named(shared_data: Path) -> None:
    frame = frame_of(shared_data / "real/azure_kinect_nfov/bag")
    config = PrimitiveConfig(stride=4, candidates=150)
    found = [f for f in fit_primitives(frame.depth, frame.camera, config) if f.pixels.sum() > 150]
    caster = Raycaster(primitive_scene(found, frame.camera, config.stride))
    null = without_own_gap(frame, caster)
    by_itself = diagnosed(null, caster, np.zeros_like)
    assert explained_by(by_itself, "wiggling") < 0.5
    grafted = diagnosed(null, caster, lambda r: 0.01 * np.sin(2 * np.pi * r / 0.4))
    # Neighbours share this camera's noise; the floor holds that part, too.
    assert grafted.gap.before.rmse > 3 * grafted.gap.floor_mm
    assert above_floor(by_itself) < 0.25 * above_floor(grafted)
    assert explained_by(grafted, "wiggling") > 0.9


def test_a_single_real_frame_of_distances_yields_radial_depth(shared_data: Path, tmp_path: Path) -> None:
    bag = shared_data / "real/ifm_o3r/bag_radial"
    first = frame_of(bag, "radial")
    config = PrimitiveConfig(stride=4, candidates=150)
    room = save_scene(primitive_scene(fit_primitives(first.depth, first.camera, config), first.camera, config.stride), tmp_path / "room")
    out = tmp_path / "gap"
    assert main(["gap", str(bag), "--scene", str(room), "--initial-pose", "0 0 0 0 0 0 1", "--out", str(out)]) == 0
    report = json.loads((out / "gap.json").read_text())
    assert report["verdict"] == ["radial_depth"]
    assert report["gap"]["shrink"] > 0.9
    assert report["not_testable"]["wiggling"] == "1 views are too few"


@pytest.mark.slow
@pytest.mark.usefixtures("no_page")
@pytest.mark.parametrize(("case", "expected"), [("example_null", ["none"]), ("example_wiggling", ["wiggling"])])
def test_sessions_of_a_foreign_renderer(shared_data: Path, tmp_path: Path, case: str, expected: list[str]) -> None:
    folder = shared_data / "cases" / case
    assert main(["gap", str(folder / "bag"), "--scene", str(folder / "scene" / "scene.yaml"), "--out", str(tmp_path)]) == 0
    assert json.loads((tmp_path / "gap.json").read_text())["verdict"] == expected
