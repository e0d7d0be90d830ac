# SPDX-License-Identifier: Apache-2.0
"""A folder of PNG pairs read as captures; what is no such folder is refused in one line."""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np
import pytest

from tof_core.errors import CameraError, ConfigError, DecodeError
from tof_core.image_folder import is_image_folder, read_image_folder
from tof_core.reasons import Reason

if TYPE_CHECKING:
    from pathlib import Path

CAMERA = """\
image_width: 4
image_height: 3
camera_name: tof
camera_matrix: {rows: 3, cols: 3, data: [10.0, 0.0, 1.5, 0.0, 11.0, 1.0, 0.0, 0.0, 1.0]}
distortion_model: plumb_bob
distortion_coefficients: {rows: 1, cols: 5, data: [0.1, 0.0, 0.0, 0.0, 0.0]}
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "camera.yaml").write_text(CAMERA)
    for k in range(2):
        cv2.imwrite(str(tmp_path / f"depth_{k}.png"), np.full((3, 4), 700 + k, np.uint16) * (np.arange(4) > 0).astype(np.uint16))
    cv2.imwrite(str(tmp_path / "ir_1.png"), np.full((3, 4), 40000, np.uint16))
    return tmp_path


def test_pairs_are_captures_in_the_order_of_their_names(folder: Path) -> None:
    assert is_image_folder(folder)
    first, second = read_image_folder(folder)
    assert first.depth[0, 1] == pytest.approx(0.7)
    assert np.isnan(first.depth[:, 0]).all()
    assert (first.reason[:, 0] == Reason.NO_RETURN).all()
    assert first.amplitude is None
    assert second.amplitude is not None
    assert second.amplitude[2, 3] == 40000.0
    assert second.stamp_ns > first.stamp_ns
    assert (first.camera.fx, first.camera.cy, first.camera.distortion[0], first.camera.frame_id) == (10.0, 1.0, 0.1, "tof")


def test_a_scale_turns_counts_into_metres(folder: Path) -> None:
    assert read_image_folder(folder, depth_scale=0.00025)[0].depth[0, 1] == pytest.approx(0.175)


def test_a_folder_without_a_camera_is_none_of_these(folder: Path) -> None:
    (folder / "camera.yaml").unlink()
    assert not is_image_folder(folder)


@pytest.mark.parametrize(
    ("name", "content", "error", "says"),
    [
        ("depth_0.png", b"junk", DecodeError, "no PNG"),
        ("depth_0.png", cv2.imencode(".png", np.zeros((3, 4), np.uint8))[1].tobytes(), DecodeError, "uint8 and not uint16"),
        ("depth_0.png", cv2.imencode(".png", np.zeros((2, 4), np.uint16))[1].tobytes(), CameraError, "4x2"),
        ("ir_1.png", cv2.imencode(".png", np.zeros((3, 4, 3), np.uint8))[1].tobytes(), DecodeError, "single-channel"),
        ("camera.yaml", CAMERA.replace("camera_matrix", "matrix").encode(), ConfigError, "camera_matrix"),
        ("camera.yaml", CAMERA.replace("[10.0,", "[0.0,").encode(), CameraError, "uncalibrated"),
        ("camera.yaml", CAMERA.replace("image_width: 4", "image_width: four").encode(), ConfigError, "no camera calibration"),
    ],
)
def test_damaged_files_are_refused_in_one_line(folder: Path, name: str, content: bytes, error: type[Exception], says: str) -> None:
    (folder / name).write_bytes(content)
    with pytest.raises(error, match=says) as raised:
        read_image_folder(folder)
    assert "\n" not in str(raised.value)
