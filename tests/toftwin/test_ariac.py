# SPDX-License-Identifier: Apache-2.0
"""NIST's ARIAC tray with pump, battery, regulator and sensor: simulated, corrected to, inspected, from the command line."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import numpy as np
import pytest

from benchmarks.sdf import write_sdf_scene
from tof_core import se3
from tof_core.config import from_mapping
from tof_scene.scene_file import load_scene
from tof_virtual.config import VirtualConfig
from tof_virtual.record import record
from tof_virtual.robot import HAND_OF_CAMERA
from toftwin.cli import main
from toftwin.commands.simulate import bodies_of

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.shared
SMALL = ["--set", "camera.width=160", "--set", "camera.height=120", "--set", "plan.range_min_m=0.6", "--set", "plan.range_max_m=0.7"]


@pytest.fixture(scope="module")
def scene(shared_data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_sdf_scene(shared_data / "cad" / "ariac", tmp_path_factory.mktemp("ariac"))


@pytest.fixture(scope="module")
def first(scene: Path) -> Path:
    """One view of the complete tray, in colour."""
    bag = scene.parent / "first"
    flags = [*SMALL, "--set", "output.colour=true", "--set", "robot.base_min_mm=0", "--set", "robot.base_max_mm=0.1"]
    assert main(["simulate", "--scene", str(scene), "--out", str(bag), "--views", "1", "--captures", "6", "--seed", "2", *flags]) == 0
    return bag


@pytest.fixture(scope="module")
def later(scene: Path) -> Path:
    """The same view on another day: the base off by 40 mm, the battery gone."""
    plan = {"views": 1, "stations": 1, "captures": 6, "range_min_m": 0.6, "range_max_m": 0.7}
    robot = {"base_min_mm": 40.0, "base_max_mm": 45.0}
    settings = {"plan": plan, "robot": robot, "camera": {"width": 160, "height": 120}, "output": {"colour": True}, "seed": 2}
    bodies = [b for b in bodies_of(load_scene(scene)) if b.name != "battery"]
    record(bodies, scene.parent / "later", from_mapping(VirtualConfig, settings))
    return scene.parent / "later"


def test_the_hand_is_corrected_and_the_missing_battery_is_reported(
    scene: Path, first: Path, later: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    kept = str(scene.parent / "ref")
    assert main(["correct", str(first), "--save", kept, "--scene", str(scene)]) == 0
    capsys.readouterr()
    assert main(["correct", str(later), "--reference", kept, "--scene", str(scene), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    with np.load(first.with_name("first.truth.npz")) as a, np.load(later.with_name("later.truth.npz")) as b:
        T_first, T_later = a["T_cell_camera"][0], b["T_cell_camera"][0]
    delta = se3.inverse(HAND_OF_CAMERA) @ se3.exp(told["reference"]["delta"]) @ HAND_OF_CAMERA
    metres, degrees = se3.distance(T_later @ delta, T_first)
    assert 1e3 * metres < 2.0
    assert degrees < 0.2
    assert main(["inspect", str(later), "--scene", str(scene), "--reference", kept, "--json"]) == 1
    told = json.loads(capsys.readouterr().out)
    states = {p["name"]: p["state"] for p in told["parts"]}
    assert states.pop("sensor") in ("present", "not_observable")  # hardly in the picture
    assert states == {"pump": "present", "battery": "absent", "regulator": "present"}
    assert told["evidence"] == "depth and colour (pairs of a current image with a reference image: 1)"
