# SPDX-License-Identifier: Apache-2.0
"""`train --rendered`: views of a scene around the poses of a dataset, as a sensor model measures them; no image of the dataset is read."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tests.tof_infer.made import CAMERA, write_dataset
from tof_core.errors import ConfigError, RefusedError
from tof_core.se3 import distance
from tof_scene.builtin import open_scene
from tof_sensor.effects.cad_deviation import CadDeviation
from tof_sensor.effects.hand_eye import HandEye
from tof_sensor.effects.range_offset import RangeOffset
from tof_sensor.model import SensorModel, save_model
from tof_sim_label.dataset import open_dataset
from toftwin import rendered
from toftwin.cli import main
from toftwin.rendered import RenderedConfig, near_dataset, of_depth
from toftwin.rendered_training import rendered as render

if TYPE_CHECKING:
    from pathlib import Path

OFFSET_M, GAIN, ALBEDO, WALL_M = 0.02, 100.0, 0.4, 1.0
SCENE = """frame: cell
parts:
- {name: wall, mesh: wall.stl, pose: [0, 0, 1.05, 0, 0, 0, 1], material: {albedo: 0.4}}
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A dataset whose images say nothing, the scene of a wall 1 m before its cameras, and a camera that measures 20 mm too far."""
    import trimesh

    trimesh.creation.box((9.0, 9.0, 0.1)).export(tmp_path / "wall.stl")
    (tmp_path / "scene.yaml").write_text(SCENE)
    write_dataset(tmp_path / "dataset.zarr", views=3, stations=3, damage="raw", damaged=3)
    save_model(SensorModel((RangeOffset(OFFSET_M),), gain=GAIN), tmp_path / "sensor.yaml")
    return tmp_path


def made(folder: Path, views: int = 6, *, fresh: bool = False) -> Path:
    scene = open_scene(folder / "scene.yaml")
    return render([folder / "dataset.zarr"], scene, folder / "sensor.yaml", folder / "net.onnx", views, fresh=fresh)


def test_views_are_those_of_the_modelled_camera(folder: Path) -> None:
    data, config = open_dataset(made(folder)), RenderedConfig()
    assert (data.captures, data.views) == (6, 6)
    for k, pose in enumerate(data.column("views/T_cell_camera")):
        metres, degrees = distance(pose, np.eye(4))
        assert 0 < metres <= np.sqrt(3) * config.spread_m
        assert 0 < degrees <= np.sqrt(3) * config.spread_deg
        label, raw, amplitude = data.frame("views/label", k), data.frame("captures/raw", k), data.frame("captures/amplitude", k)
        seen = data.frame("views/mask", k) > 0
        assert seen.mean() > 0.9
        z = (WALL_M - pose[2, 3]) / (CAMERA.rays() @ pose[2, :3])
        np.testing.assert_allclose(label[seen], z[seen], atol=1e-5)
        np.testing.assert_allclose(((raw - label) * CAMERA.ray_length())[seen], OFFSET_M, atol=1e-5)
        cosine = np.cos(data.frame("views/incidence", k))
        np.testing.assert_allclose(amplitude[seen], (GAIN * ALBEDO * cosine / (z * CAMERA.ray_length()) ** 2)[seen], rtol=1e-4)


def test_rendered_views_are_kept_unless_fresh_is_set(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made(folder)
    drawn = list[int]()
    view = rendered._view

    def counted(*args: object) -> object:
        drawn.append(1)
        return view(*args)  # type: ignore[arg-type]

    monkeypatch.setattr(rendered, "_view", counted)
    made(folder)
    assert not drawn
    made(folder, fresh=True)
    assert len(drawn) == 6


def test_effects_that_move_the_true_depth_are_no_error_of_depth() -> None:
    model = SensorModel((CadDeviation(), HandEye(), RangeOffset(OFFSET_M)))
    assert of_depth(model).names == ("range_offset",)


def test_without_a_unit_of_amplitude_nothing_is_rendered(folder: Path) -> None:
    save_model(SensorModel((RangeOffset(OFFSET_M),)), folder / "sensor.yaml")
    with pytest.raises(ConfigError, match="states no gain"):
        made(folder)


def test_poses_that_were_not_accepted_are_not_used(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from tof_scene.raycast import Raycaster

    caster = Raycaster(open_scene(folder / "scene.yaml"))
    assert len(near_dataset(folder / "dataset.zarr", caster, GAIN)) == 3
    data = open_dataset(folder / "dataset.zarr")
    data.verdicts = ("too few pixels",) * 3
    monkeypatch.setattr("tof_sim_label.dataset.open_dataset", lambda _: data)
    with pytest.raises(RefusedError, match="no view has an accepted pose"):
        near_dataset(folder / "dataset.zarr", caster, GAIN)


@pytest.mark.parametrize(
    ("flags", "words"),
    [
        (["--rendered", "--scene", "scene.yaml"], "needs the camera's model"),
        (["--rendered", "--sensor", "sensor.yaml"], "needs what the datasets show"),
        (["--scene", "scene.yaml"], "is for --rendered alone"),
    ],
)
def test_a_call_that_lacks_something_is_refused(
    flags: list[str], words: str, folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(folder)
    assert main(["train", "dataset.zarr", "--out", "net.onnx", *flags]) == 2
    assert words in capsys.readouterr().err


@pytest.mark.train
def test_a_network_is_trained_on_rendered_views_alone(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("torch", reason="training needs the extra `train`")
    call = [
        "train",
        str(folder / "dataset.zarr"),
        "--rendered",
        "--scene",
        str(folder / "scene.yaml"),
        "--sensor",
        str(folder / "sensor.yaml"),
    ]
    small = ["--views", "9", "--epochs", "1", "--threads", "1", "--set", "net.base=4", "--set", "net.levels=2"]
    assert main([*call, "--out", str(folder / "net.onnx"), "--json", *small]) == 0
    figures = json.loads(capsys.readouterr().out)
    assert figures["val_raw_mae_mm"] == pytest.approx(1e3 * OFFSET_M / float(CAMERA.ray_length().mean()), rel=0.05)
    card = json.loads((folder / "net.json").read_text())
    assert [d["pose_source"] for d in card["data"]] == ["simulated"]
