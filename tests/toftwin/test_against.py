# SPDX-License-Identifier: Apache-2.0
"""`toftwin gap REAL --against SIMULATED`: what a simulator lacks is named, in the files and on the page."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import pytest

from tests.toftwin.once import once
from tof_core.camera import Camera
from tof_core.config import from_mapping
from tof_core.errors import UsageError
from tof_scene.builtin import write_builtin
from tof_scene.raycast import Raycaster
from tof_scene.scene_file import load_scene
from tof_virtual.config import VirtualConfig
from tof_virtual.record import record
from toftwin import against
from toftwin.against import diagnose_simulated
from toftwin.cli import main
from toftwin.commands.simulate import bodies_of
from toftwin.diagnosis import GapPipelineConfig

if TYPE_CHECKING:
    from pathlib import Path

SMALL = {"camera.width": 112, "camera.height": 86, "plan.views": 6}


def test_what_the_simulator_lacks_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(against, "diagnose_simulated", once(against.diagnose_simulated))
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
    assert "Not testable in the simulator" in page

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


def test_a_simulator_of_another_resolution_is_refused(tmp_path: Path) -> None:
    bodies = bodies_of(load_scene(write_builtin("body_section", tmp_path / "scene")))
    record(bodies, tmp_path / "simulated", from_mapping(VirtualConfig, SMALL | {"camera.width": 96}))
    camera = Camera(112, 86, 100.0, 100.0, 55.5, 42.5)
    caster = Raycaster(load_scene(tmp_path / "scene" / "scene.yaml"))
    with pytest.raises(UsageError, match="96x86 pixels, and the camera's 112x86"):
        diagnose_simulated(str(tmp_path / "simulated"), caster, camera, GapPipelineConfig(), progress=lambda _: None)
