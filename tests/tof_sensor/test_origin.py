# SPDX-License-Identifier: Apache-2.0
"""A sensor model states its camera and its promise, and is refused on another camera."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import pytest
import yaml

from tof_core.camera import Camera
from tof_core.errors import ConfigError, RefusedError
from tof_sensor.effects.range_offset import RangeOffset
from tof_sensor.model import SensorModel, load_model, save_model
from tof_sensor.origin import Promise, check_camera, differences

if TYPE_CHECKING:
    from pathlib import Path

CAMERA = Camera(224, 171, 210.25, 210.5, 111.5, 85.0, "plumb_bob", (0.1, -0.05, 0.0, 0.0, 0.0))


def test_camera_and_promise_survive_the_file(tmp_path: Path) -> None:
    model = SensorModel((RangeOffset(0.01),), 100.0, CAMERA, Promise(0.93, 0.9, 0.96))
    save_model(model, tmp_path / "sensor.yaml")
    assert load_model(tmp_path / "sensor.yaml") == model


@pytest.mark.parametrize(
    "here",
    [CAMERA, replace(CAMERA, frame_id="hand"), replace(CAMERA, fx=210.2500001), replace(CAMERA, distortion=(0.1, -0.05))],
    ids=["itself", "another name of its frame", "rounding", "zeros left out"],
)
def test_a_model_fits_its_own_camera(here: Camera) -> None:
    check_camera(CAMERA, here)
    check_camera(None, here)


@pytest.mark.parametrize(
    ("here", "differs"),
    [
        (replace(CAMERA, width=128), "width 224 against 128"),
        (replace(CAMERA, fy=212.0), "fy 210.5 against 212"),
        (replace(CAMERA, distortion=(0.12, -0.05, 0.0, 0.0, 0.0)), "distortion"),
    ],
)
def test_a_model_is_refused_on_another_camera(here: Camera, differs: str) -> None:
    with pytest.raises(RefusedError, match=differs):
        check_camera(CAMERA, here)


def test_before_a_diagnosis_the_lens_may_be_that_of_another_unit() -> None:
    other = replace(CAMERA, fx=204.0, cx=118.0, distortion=(0.12, 0.0))
    assert differences(CAMERA, other) == ["fx 210.25 against 204", "cx 111.5 against 118", "distortion"]
    check_camera(CAMERA, other, any_lens=True)
    with pytest.raises(RefusedError, match=r"fx 210\.25 against 180"):
        check_camera(CAMERA, replace(CAMERA, fx=180.0), any_lens=True)
    with pytest.raises(RefusedError, match="width 224 against 128"):
        check_camera(CAMERA, replace(CAMERA, width=128), any_lens=True)


@pytest.mark.parametrize(
    "change",
    [
        {"camera": {"width": 224}},
        {"camera": 3},
        {"promise": {"shrink": 0.9}},
        {"promise": {"shrink": 0.9, "ci95": [0.8]}},
        {"promise": {"shrink": float("nan"), "ci95": [0.8, 1.0]}},
        {"promise": [0.9, 0.8, 1.0]},
    ],
)
def test_a_block_that_is_no_camera_or_promise_is_refused(tmp_path: Path, change: dict[str, Any]) -> None:
    path = tmp_path / "sensor.yaml"
    path.write_text(yaml.safe_dump({"schema": "toftwin.sensor/1", "effects": []} | change))
    with pytest.raises(ConfigError, match=r"camera must|promise must"):
        load_model(path)
