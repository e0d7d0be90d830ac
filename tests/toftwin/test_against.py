# SPDX-License-Identifier: Apache-2.0
"""`toftwin gap REAL --against SIMULATED`: what a simulator lacks is named, in the files and on the page."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

from tof_core.config import from_mapping
from tof_scene.builtin import write_builtin
from tof_scene.scene_file import load_scene
from tof_virtual.config import VirtualConfig
from tof_virtual.record import record
from toftwin.cli import main
from toftwin.commands.simulate import bodies_of

if TYPE_CHECKING:
    from pathlib import Path

    import pytest

SMALL = {"camera.width": 112, "camera.height": 86, "plan.views": 6}


def test_what_the_simulator_lacks_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene = write_builtin("body_section", tmp_path / "scene")
    for name, seed, effects in (("real", 5, {"wiggling": 1.0}), ("simulated", 6, {})):
        record(bodies_of(load_scene(scene)), tmp_path / name, from_mapping(VirtualConfig, SMALL | {"seed": seed}), effects=effects)
    call = ["gap", str(tmp_path / "real"), "--scene", str(scene), "--out", str(tmp_path / "out")]
    assert main([*call, "--against", str(tmp_path / "simulated")]) == 0
    found: dict[str, Any] = json.loads((tmp_path / "out" / "against.json").read_text())
    assert found["verdict"] == ["wiggling"]
    (lacking,) = found["differences"]
    assert (lacking["simulator"], lacking["todo"]) == ("lacks", "give the simulator the wiggling of sensor.yaml")
    assert lacking["real_mm"] > 10 * lacking["simulated_mm"]
    assert found["distance"]["after_mm"] < 0.5 * found["distance"]["before_mm"]
    assert "the simulator lacks wiggling" in capsys.readouterr().out
    page = (tmp_path / "out" / "report.html").read_text()
    assert "Your simulator against this camera" in page
    assert "the simulator lacks wiggling" in page
    assert "not testable in the simulator" in page

    # The same camera whose wiggling has no name: 4 mm without a cause are no right simulator, and the report is written all the same.
    assert main([*call, "--against", str(tmp_path / "simulated"), "--leave-out", "wiggling"]) == 0
    found = json.loads((tmp_path / "out" / "against.json").read_text())
    assert (found["verdict"], found["differences"]) == (["unknown"], [])
    assert found["unknown"]["camera"]["rms_mm"] > 1.0
    said = capsys.readouterr().out
    assert "no effect is certain enough to be named as a difference" in said
    assert "has the camera's effects" not in said
    page = (tmp_path / "out" / "report.html").read_text()
    assert "unknown: errors of the camera without a certain cause" in page
