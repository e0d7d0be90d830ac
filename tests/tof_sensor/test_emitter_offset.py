# SPDX-License-Identifier: Apache-2.0
"""A lamp beside the lens: path lengths of a triangle, what range changes of them, and what a diagnosis names."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tests.tof_sensor.plane import CAMERA, NORMAL, plane_depth, plane_frame
from tof_core.config import from_mapping
from tof_scene.builtin import write_builtin
from tof_scene.scene_file import load_scene
from tof_sensor.effects.emitter_offset import EmitterOffset
from tof_virtual.config import VirtualConfig
from tof_virtual.record import record
from toftwin.cli import main
from toftwin.commands.simulate import bodies_of

if TYPE_CHECKING:
    from pathlib import Path

    from tof_sensor.frame import Frame


def at(range_m: float) -> Frame:
    """A tilted plane whose nearest point is that far from the lens."""
    frame, depth = plane_frame(), plane_depth(CAMERA.rays(), NORMAL, -range_m)
    return replace(frame, depth=depth, rendering=replace(frame.rendering, depth=depth.astype(np.float32)))


def test_the_error_is_half_of_what_the_way_from_the_lamp_is_longer() -> None:
    offset = EmitterOffset(x_m=0.03, y_m=0.0)
    frame = at(0.5)
    lamp = np.array([0.03, 0.0, 0.0])
    for row, column in ((0, 0), (15, 20), (29, 39)):
        point = frame.points[row, column]
        path = np.linalg.norm(point - lamp) + np.linalg.norm(point)
        measured = frame.radial[row, column] + (offset.bias(frame) * frame.length)[row, column]
        assert measured == pytest.approx(0.5 * path, abs=1e-12)


def test_the_place_is_stated_from_where_the_driver_takes_the_lamp_to_be() -> None:
    stated = EmitterOffset(x_m=0.0223, y_m=-0.004).stated
    assert stated.startswith("lamp 22.3 mm to the right and 4.0 mm above, in the image's directions, of where the driver takes it to be")


def test_the_side_of_the_lamp_is_measured_too_near() -> None:
    right, below = EmitterOffset(x_m=0.03).bias(at(1.0)), EmitterOffset(y_m=0.03).bias(at(1.0))
    assert (right[:, 35:] < -0.002).all()
    assert (right[:, :5] > 0.002).all()
    assert (below[26:] < -0.002).all()
    assert (below[:4] > 0.002).all()


@pytest.mark.parametrize(("offset_m", "range_m", "share"), [(0.01, 0.3, 0.06), (0.05, 0.3, 0.3), (0.05, 1.0, 0.1), (0.05, 2.0, 0.05)])
def test_second_order_is_this_share_of_the_bias(offset_m: float, range_m: float, share: float) -> None:
    lamp, frame = EmitterOffset(x_m=offset_m), at(range_m)
    exact, first = lamp.bias(frame), frame.valid * (lamp.columns(frame) @ lamp.coefficients)
    left = float(np.sqrt(np.mean((exact - first) ** 2) / np.mean(exact**2)))
    assert 0.5 * share < left < share
    second = (offset_m**2 - (offset_m * frame.rays[..., 0] / frame.length) ** 2) / (4 * frame.radial) / frame.length
    np.testing.assert_allclose(exact, first + second, atol=offset_m**3 / range_m**2)


@pytest.mark.slow
@pytest.mark.usefixtures("no_page")
def test_a_lamp_of_3_cm_is_named_and_placed(tmp_path: Path) -> None:
    scene = write_builtin("body_section", tmp_path / "scene")
    settings = {"seed": 7, "camera.width": 112, "camera.height": 86, "plan.views": 12}
    record(bodies_of(load_scene(scene)), tmp_path / "bag", from_mapping(VirtualConfig, settings), effects={"emitter_offset": 1.0})
    assert main(["gap", str(tmp_path / "bag"), "--scene", str(scene), "--out", str(tmp_path / "gap")]) == 0
    report = json.loads((tmp_path / "gap" / "gap.json").read_text())
    assert report["verdict"] == ["emitter_offset"]
    true = json.loads((tmp_path / "bag.truth.json").read_text())["effects"]["emitter_offset"]["params"]["lamp_m"]
    params = report["causes"][0]["params"]
    np.testing.assert_allclose([params["x_m"], params["y_m"]], true[:2], atol=0.0015)
