# SPDX-License-Identifier: Apache-2.0
"""Sessions that lack what a diagnosis needs: what cannot be tested is said, what cannot be diagnosed is refused."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from tests.tof_gap.quiet_views import CAMERA, views
from tof_core.capture import RobotPose
from tof_core.config import from_mapping
from tof_core.errors import RefusedError, UsageError
from tof_gap.diagnose import check
from tof_gap.limits.noise import NoiseLimits
from tof_gap.solve.hypotheses.candidates import not_testable
from tof_scene.builtin import write_builtin
from tof_sensor.registry import VOCABULARY, left_out
from toftwin.cli import main
from toftwin.commands.gap import EFFECTS

if TYPE_CHECKING:
    from pathlib import Path


def recorded(folder: Path, **settings: Any) -> tuple[str, str]:
    """A small quiet session of the virtual robot: bag and scene."""
    from tof_scene.scene_file import load_scene
    from tof_virtual.config import VirtualConfig
    from tof_virtual.record import record
    from toftwin.commands.simulate import bodies_of

    scene = write_builtin("body_section", folder / "scene")
    size = {"seed": 8, "camera.width": 112, "camera.height": 86, "plan.stations": 1}
    record(bodies_of(load_scene(scene)), folder / "bag", from_mapping(VirtualConfig, size | settings))
    return str(folder / "bag"), str(scene)


@pytest.fixture(scope="module")
def bare(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, str]:
    """Five views without amplitude, temperature or motion."""
    return recorded(tmp_path_factory.mktemp("bare"), **{"plan.views": 5, "output.amplitude": False, "output.temperature": False})


def test_effects_that_a_minimal_session_cannot_test_are_listed(bare: tuple[str, str], tmp_path: Path) -> None:
    bag, scene = bare
    assert main(["gap", bag, "--scene", scene, "--out", str(tmp_path)]) == 0
    report = json.loads((tmp_path / "gap.json").read_text())
    why = report["not_testable"]
    assert (
        why["amplitude_bias"]
        == why["lens_scatter"]
        == "no amplitude image (if the recording has one under another name, pass --amplitude-topic)"
    )
    assert why["motion"] == why["time_sync"] == "no view was taken in motion"
    assert why["temperature_drift"] == "5 of 5 views have no temperature, and the session is shorter than 60 s"
    assert report["verdict"] == ["none"]
    assert report["gap"]["floor_from"].startswith("5 of 5 views are of one capture: noise, which a pixel does not share with others nearby")
    assert "5 of 5 views are of one capture" in (tmp_path / "report.html").read_text()


def test_a_wrong_unit_is_refused_by_its_factor(bare: tuple[str, str], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bag, scene = bare
    assert main(["gap", bag, "--scene", scene, "--out", str(tmp_path), "--depth-scale", "0.01"]) == 1
    assert "times what the scene expects" in capsys.readouterr().err


def test_too_few_views_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bag, scene = recorded(tmp_path, **{"plan.views": 2})
    assert main(["gap", bag, "--scene", scene, "--out", str(tmp_path / "gap")]) == 1
    assert "2 views are too few to diagnose; record at least 4" in capsys.readouterr().err


def test_a_bag_of_another_scene_is_refused(bare: tuple[str, str], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    other = write_builtin("housing", tmp_path / "other")
    assert main(["gap", bare[0], "--scene", str(other), "--out", str(tmp_path / "gap")]) == 1
    assert "fits this scene nowhere" in capsys.readouterr().err


def test_an_unknown_effect_cannot_be_left_out(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Said before the bag is opened, let alone diagnosed for minutes as if nothing were forbidden."""
    call = ["gap", str(tmp_path), "--scene", "body_section", "--out", str(tmp_path / "gap")]
    assert main([*call, "--leave-out", "wiggling", "--leave-out", "wigling"]) == 2
    said = capsys.readouterr().err
    assert said.startswith("toftwin: --leave-out: there is no effect 'wigling'; did you mean wiggling? effects: ambient, amplitude_bias, ")
    assert "wiggling" in said.partition("effects:")[2]
    assert main([*call, "--leave-out", "wiggling"]) == 1
    assert "there is no effect" not in capsys.readouterr().err


def test_a_name_like_no_effect_s_is_refused_with_the_names_that_there_are() -> None:
    with pytest.raises(UsageError, match=r"there is no effect 'xyz'; effects: ambient, "):
        left_out(["xyz"], "--leave-out")
    with pytest.raises(UsageError, match="did you mean temperature_drift"):
        left_out(["temperature"], "--leave-out")


def test_the_help_lists_every_effect_that_may_be_left_out() -> None:
    assert EFFECTS.split(", ") == list(VOCABULARY)


def test_mixed_cameras_are_refused() -> None:
    posed = [replace(v.view, robot=RobotPose(np.eye(4), np.eye(4))) for v in views(np.random.default_rng(1))]
    check(posed, 4)
    with pytest.raises(RefusedError, match="2 different cameras"):
        check([*posed, replace(posed[0], camera=replace(CAMERA, fx=CAMERA.fx + 1))], 4)
    with pytest.raises(RefusedError, match="no view has a robot pose"):
        check([replace(v, robot=None) for v in posed], 4)


def test_one_range_cannot_show_a_wiggle() -> None:
    session = views(np.random.default_rng(1))
    near = [replace(v, pixels=v.pixels[np.abs(v.frame.radial.ravel()[v.pixels] - 0.95) < 0.02]) for v in session[:3]]
    assert not_testable(near, NoiseLimits())["wiggling"] == "the ranges span less than 80 mm"
    assert "wiggling" not in not_testable(session, NoiseLimits())
