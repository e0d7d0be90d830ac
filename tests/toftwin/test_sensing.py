# SPDX-License-Identifier: Apache-2.0
"""`toftwin sensor`: a bag of ideal depth becomes a bag as the modelled camera records it."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tof_core.bag import open_bag
from tof_core.bag_writer import BagWriter
from tof_core.camera import Camera
from tof_core.options import BagOptions
from tof_sensor.effects.dropout import Dropout
from tof_sensor.effects.range_offset import RangeOffset
from tof_sensor.model import SensorModel, save_model
from toftwin.cli import main

if TYPE_CHECKING:
    from pathlib import Path

CAMERA = Camera(40, 30, 38.0, 38.0, 19.5, 14.5, frame_id="sim_camera")
FRAMES, PERIOD_NS, START_NS = 4, 33_000_000, 10**18
TILTED = np.array([0.6, 0.0, -0.8])


@pytest.fixture
def ideal(tmp_path: Path) -> Path:
    """A wall seen four times alike, its albedo, wrong normals, and TF."""
    with BagWriter(tmp_path / "ideal") as bag:
        for stamp in range(START_NS, START_NS + FRAMES * PERIOD_NS, PERIOD_NS):
            bag.camera_info("/sim/depth/camera_info", CAMERA, stamp)
            bag.image("/sim/depth/image", np.full(CAMERA.shape, 1.5, np.float32), "32FC1", "sim_camera", stamp)
            bag.image("/sim/ir/image", np.full(CAMERA.shape, 0.5, np.float32), "32FC1", "sim_camera", stamp)
            bag.image("/sim/normals", np.broadcast_to(TILTED.astype(np.float32), (*CAMERA.shape, 3)).copy(), "32FC3", "sim_camera", stamp)
            bag.tf(stamp, [("world", "sim_camera", np.eye(4))])
    save_model(SensorModel((RangeOffset(0.03), Dropout(random=0.1)), gain=100.0), tmp_path / "sensor.yaml")
    return tmp_path / "ideal"


def called(ideal: Path, *more: str) -> list[str]:
    return ["sensor", str(ideal), "--sensor", str(ideal.parent / "sensor.yaml"), "--out", str(ideal.parent / "out"), *more]


def test_every_frame_is_measured_and_the_rest_of_the_bag_is_kept(ideal: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(called(ideal, "--json")) == 0
    counts = json.loads(capsys.readouterr().out)
    assert counts["frames"] == FRAMES
    assert counts["effects"] == ["dropout", "range_offset"]
    assert counts["lost"] == pytest.approx(0.1, abs=0.02)
    with open_bag(ideal.parent / "out", BagOptions()) as reader:
        assert reader.topics.depth == "/sensor/depth"
        assert reader.topics.amplitude == "/sensor/amplitude"
        assert "/tf" in reader.types
        assert "/sim/depth/image" not in reader.types
        captures = list(reader.captures(need_tf=False))
    assert [c.stamp_ns for c in captures] == list(range(START_NS, START_NS + FRAMES * PERIOD_NS, PERIOD_NS))
    for capture in captures:
        error = capture.depth * CAMERA.ray_length() - 1.5 * CAMERA.ray_length()
        assert np.nanmax(np.abs(error - 0.03)) < 1e-5
        assert capture.amplitude is not None
        assert capture.amplitude[15, 20] == pytest.approx(100 * 0.5 / 1.5**2, rel=0.01)
    assert np.isnan(captures[0].depth).sum() != np.isnan(np.stack([c.depth for c in captures])).all(axis=0).sum()


def test_what_the_ideal_bag_lacks_is_printed_and_another_camera_leaves_no_bag(ideal: Path, capsys: pytest.CaptureFixture[str]) -> None:
    model = SensorModel((RangeOffset(0.03),), gain=100.0, camera=replace(CAMERA, fx=38.4))
    save_model(model, ideal.parent / "sensor.yaml")
    assert main(called(ideal)) == 0
    said = capsys.readouterr().out
    assert "note: the simulator's CameraInfo is not that of sensor.yaml (fx 38.4 against 38)" in said
    assert "note: edges stay as ideal as they are" in said
    shutil.rmtree(ideal.parent / "out")
    save_model(replace(model, camera=replace(CAMERA, width=44)), ideal.parent / "sensor.yaml")
    assert main(called(ideal)) == 1
    assert "was fitted to another camera (width 44 against 40" in capsys.readouterr().err
    assert not (ideal.parent / "out").exists()


def test_normals_of_a_topic_dim_what_faces_away(ideal: Path) -> None:
    assert main(called(ideal, "--normals-topic", "/sim/normals")) == 0
    with open_bag(ideal.parent / "out", BagOptions()) as reader:
        first = next(reader.captures(need_tf=False))
    assert first.amplitude is not None
    ray = CAMERA.rays()[15, 20]
    assert first.amplitude[15, 20] == pytest.approx(100 * 0.5 * abs(ray @ TILTED) / np.linalg.norm(ray) / 1.5**2, rel=0.01)


def test_wrong_calls_are_refused_and_leave_nothing(ideal: Path, capsys: pytest.CaptureFixture[str]) -> None:
    save_model(SensorModel((RangeOffset(0.03),)), ideal.parent / "sensor.yaml")
    assert main(called(ideal)) == 1
    assert "--gain" in capsys.readouterr().err
    assert not (ideal.parent / "out").exists()
    assert main(called(ideal, "--gain", "50", "--normals-topic", "/nothing")) == 1
    assert "has no images on /nothing" in capsys.readouterr().err
    (ideal.parent / "out").mkdir()
    assert main(called(ideal)) == 2
    assert "exists already" in capsys.readouterr().err
