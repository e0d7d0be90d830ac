# SPDX-License-Identifier: Apache-2.0
"""The command `toftwin simulate`."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tests.tof_virtual.made import config
from tof_core.bag import open_bag
from tof_virtual.truth import load_truth
from toftwin.cli import main

if TYPE_CHECKING:
    from pathlib import Path

SMALL = ["--scene", "body_section", "--views", "2", "--stations", "1", "--size", "64x48", "--quiet", "--set", "output.encoding=32FC1"]


def test_a_built_in_scene_becomes_a_bag_with_its_scene_and_truth(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bag = tmp_path / "session"
    assert main(["simulate", *SMALL, "--out", str(bag), "--effect", "wiggling=1", "--captures", "2", "--seed", "4"]) == 0
    assert "wiggling: 3.0" in capsys.readouterr().out
    assert (tmp_path / "session.scene" / "scene.yaml").exists()
    truth, meta = load_truth(tmp_path / "session.truth")
    assert truth["depth"].shape == (2, 48, 64)
    assert meta["effects"]["wiggling"]["strength"] == 1.0
    with open_bag(bag, cell_frame="cell") as reader:
        captures = list(reader.captures())
    assert [c.stamp_ns for c in captures][1::2] == truth["stamp_ns"].tolist()
    error = captures[0].depth - truth["depth"][0] - truth["bias_wiggling"][0]
    assert abs(np.nanmedian(error)) < 5e-4


def test_a_fitted_sensor_acts_on_every_frame(tmp_path: Path) -> None:
    sensor = tmp_path / "sensor.yaml"
    sensor.write_text("schema: toftwin.sensor/1\neffects:\n- {effect: range_offset, offset_m: 0.02}\n")
    for name, more in (("plain", []), ("sensed", ["--sensor", str(sensor)])):
        assert main(["simulate", *SMALL, "--out", str(tmp_path / name), *more]) == 0
    depth = {}
    for name in ("plain", "sensed"):
        with open_bag(tmp_path / name, cell_frame="cell") as reader:
            depth[name] = next(iter(reader.captures())).depth
    assert np.nanmedian(depth["sensed"] - depth["plain"]) == pytest.approx(0.02, abs=0.0025), "20 mm along the ray, less along the axis"


def test_json_describes_the_recording(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["simulate", *SMALL, "--out", str(tmp_path / "a"), "--effect", "quantization", "--json"]) == 0
    shown = json.loads(capsys.readouterr().out)
    assert shown["views"] == 2
    assert shown["effects"]["quantization"]["size"] == pytest.approx(0.0103923, rel=1e-5)


@pytest.mark.parametrize(
    ("flags", "line"),
    [
        (["--effect", "wobble=1"], "effect 'wobble' is not known"),
        (["--effect", "wiggling=much"], "'wiggling=much' is not NAME=STRENGTH"),
        (["--size", "wide"], "'wide' is not WIDTHxHEIGHT"),
        (["--scene", "nowhere.yaml"], "nowhere.yaml: does not exist"),
        (["--set", "plan.views=0"], "below 1"),
    ],
)
def test_wrong_calls_give_one_line_and_leave_nothing(
    flags: list[str],
    line: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["simulate", *SMALL, "--out", str(tmp_path / "bag"), *flags]) == 2
    shown = capsys.readouterr().err
    assert line in shown
    assert shown.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_settings_are_listed_with_their_bounds(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["simulate", "--settings"]) == 0
    shown = capsys.readouterr().out
    assert f"plan.range_min_m = {config().plan.range_min_m:g} m [0.1 .. 10]" in shown
