# SPDX-License-Identifier: Apache-2.0
"""`toftwin label` with a sensor model, and with a diagnosis of its own."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tof_core import se3
from tof_core.camera import Camera
from tof_core.capture import Posed
from tof_core.config import from_mapping
from tof_core.errors import UsageError
from tof_core.lens import with_lens
from tof_scene.builtin import write_builtin
from tof_scene.scene_file import load_scene
from tof_sensor.effects.range_offset import RangeOffset
from tof_sensor.model import SensorModel, save_model
from tof_sim_label.config import LabelConfig
from tof_sim_label.dataset import open_dataset
from tof_virtual.config import VirtualConfig
from tof_virtual.record import record
from tof_virtual.truth import load_truth
from toftwin.cli import main
from toftwin.commands.label import in_common, unsure
from toftwin.commands.simulate import bodies_of
from toftwin.known import Known
from toftwin.labelling import _lens_note
from toftwin.pipeline import PipelineConfig

if TYPE_CHECKING:
    from pathlib import Path

SMALL = {"seed": 5, "camera.width": 112, "camera.height": 86, "plan.views": 6}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A session with a range offset of 12 mm (strength 4) and a wiggle, and the sensor.yaml of the offset."""
    folder = tmp_path_factory.mktemp("known")
    scene = write_builtin("body_section", folder / "scene")
    config = from_mapping(VirtualConfig, SMALL)
    record(
        bodies_of(load_scene(scene)), folder / "bag", config, effects={"range_offset": 4.0, "wiggling": 1.0}, truth_path=folder / "truth"
    )
    save_model(SensorModel((RangeOffset(offset_m=0.012),)), folder / "sensor.yaml")
    return folder


def pose_errors(folder: Path, out: Path) -> np.ndarray:
    """(V,) millimetres between the cameras of the dataset and the truth."""
    true = load_truth(folder / "truth")[0]["T_cell_camera"]
    poses = json.loads((out / "poses.json").read_text())
    return np.array([1e3 * se3.distance(np.array(p["T_cell_camera"]), T)[0] for p, T in zip(poses, true, strict=True)])


def label_error_mm(folder: Path, out: Path) -> float:
    """Mean millimetres between usable labels and the surface that each pixel sees, on parts that are off their CAD."""
    true, data = load_truth(folder / "truth")[0], open_dataset(out / "dataset.zarr")
    errors = []
    for v in range(data.views):
        at = (data.frame("views/mask", v) > 0) & (np.abs(true["bias_cad_deviation"][v]) > 1e-4)
        errors.append((data.frame("views/label", v) - true["depth"][v])[at])
    return 1e3 * float(np.abs(np.concatenate(errors)).mean())


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["final", "causal"])
def test_the_stated_offset_is_removed_before_poses_are_solved(folder: Path, tmp_path: Path, mode: str) -> None:
    call = ["label", str(folder / "bag"), "--scene", str(folder / "scene"), "--mode", mode, "--out"]
    assert main([*call, str(tmp_path / "plain")]) == 0
    assert main([*call, str(tmp_path / "told"), "--sensor", str(folder / "sensor.yaml")]) == 0
    plain, told = pose_errors(folder, tmp_path / "plain"), pose_errors(folder, tmp_path / "told")
    assert np.median(told) < 0.8 * np.median(plain)
    hashes = {open_dataset(tmp_path / name / "dataset.zarr").attributes.config_hash for name in ("plain", "told")}
    assert len(hashes) == 2, "labels made with a sensor model are told from those without"


def test_the_joint_solution_labels_the_session_and_says_so(folder: Path, tmp_path: Path) -> None:
    call = ["label", str(folder / "bag"), "--scene", str(folder / "scene"), "--sensor", str(folder / "sensor.yaml"), "--joint", "--out"]
    assert main([*call, str(tmp_path)]) == 0
    assert np.median(pose_errors(folder, tmp_path)) < 1.0
    data = open_dataset(tmp_path / "dataset.zarr")
    assert data.attributes.pose_source == "session, final, with the effects of the diagnosis"
    usable = [data.frame("views/label_sigma", v)[data.frame("views/mask", v) > 0] for v in range(data.views)]
    stated = json.loads((tmp_path / "metrics.json").read_text())["label_sigma_mm"]
    assert stated == pytest.approx(1e3 * np.median([np.median(s) for s in usable]), rel=1e-6)


def test_labels_show_a_part_where_the_diagnosis_finds_it(tmp_path: Path) -> None:
    """Two parts are moved and bent: labels of the CAD are off by millimetres on them, those of the joint solution by a third of that at most."""
    scene, plan = write_builtin("body_section", tmp_path / "scene"), {**SMALL, "plan.views": 8}
    virtual = from_mapping(VirtualConfig, plan)
    record(bodies_of(load_scene(scene)), tmp_path / "bag", virtual, effects={"cad_deviation": 1.5}, truth_path=tmp_path / "truth")
    call = ["label", str(tmp_path / "bag"), "--scene", str(tmp_path / "scene"), "--out"]
    assert main([*call, str(tmp_path / "plain")]) == 0
    assert main([*call, str(tmp_path / "joint"), "--joint"]) == 0
    plain, joint = (label_error_mm(tmp_path, tmp_path / name) for name in ("plain", "joint"))
    assert plain > 2.5
    assert joint < plain / 3
    note = json.loads((tmp_path / "joint" / "metrics.json").read_text())["note"]
    assert "surfaces from the CAD: stand " in note
    assert "damping_mat " in note


def test_a_joint_solution_needs_the_session_and_a_model_needs_poses_that_are_solved(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="--joint"):
        Known(joint=True).check("causal")
    with pytest.raises(UsageError, match="--sensor"):
        Known(sensor=tmp_path).check("robot")
    Known(sensor=tmp_path, joint=True).check("final")


def test_the_digest_follows_the_content_of_the_model(folder: Path, tmp_path: Path) -> None:
    config, other = PipelineConfig(), tmp_path / "sensor.yaml"
    save_model(SensorModel((RangeOffset(offset_m=0.001),)), other)
    assert len({Known(path).digest(config) for path in (None, other, folder / "sensor.yaml")}) == 3


@pytest.mark.parametrize(
    ("bias_mm", "line"), [(7.32, "7.3 mm farther than the labels"), (-4.1, "4.1 mm nearer than the labels"), (3.9, ""), (float("nan"), "")]
)
def test_a_bias_common_to_all_depth_beyond_what_sigma_holds_is_a_warning(bias_mm: float, line: str) -> None:
    """A wrong lens moved depth by 7 mm and the labels by 9 mm, with a sigma of 2 mm."""
    said = in_common(bias_mm, offset_mm=2.0)
    assert line in said
    assert bool(said) == bool(line)


@pytest.mark.parametrize(
    ("sigma_mm", "words"),
    [
        pytest.param(1.8, (), id="a healthy camera"),
        pytest.param(2.0, (), id="a bias of dark pixels, labels 0.3 mm off"),
        pytest.param(4.3, ("accurate to 4.3 mm only", "label again with --joint"), id="multipath, labels 3.9 mm off"),
    ],
)
def test_labels_that_the_session_does_not_determine_are_reported_with_their_accuracy(sigma_mm: float, words: tuple[str, ...]) -> None:
    line = unsure(sigma_mm, LabelConfig(), joint=False)
    assert bool(line) == bool(words)
    assert all(w in line for w in words)


def test_an_offset_that_a_calibration_excludes_leaves_the_limit_where_it_is() -> None:
    known = LabelConfig(unseen_offset_mm=0.1)
    assert unsure(0.3, known, joint=False) == ""
    assert unsure(3.9, known, joint=False) != ""


def test_after_a_joint_solution_the_advice_is_not_joint_again() -> None:
    line = unsure(4.3, LabelConfig(), joint=True)
    assert "--joint" not in line
    assert "views from other sides" in line


def test_a_lens_that_contradicts_camera_info_is_reported() -> None:
    stated = Camera(64, 48, 60.0, 60.0, 31.5, 23.5)
    pose = Posed(np.eye(4), np.eye(6))
    near, other = (with_lens(stated, np.array([0.0, 0.0, px, 0.0, 0.0, 0.0, 0.0, 0.0])) for px in (0.05, 2.0))
    assert _lens_note(stated, [pose, pose], 0.1) == ""
    assert _lens_note(stated, [pose, replace(pose, camera=near)], 0.1) == ""
    assert "a lens 2.0 px RMS off camera_info, 2.0 px at the pixel that is off most" in _lens_note(
        stated, [pose, replace(pose, camera=other)], 0.1
    )
