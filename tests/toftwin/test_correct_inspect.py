# SPDX-License-Identifier: Apache-2.0
"""`toftwin correct` and `toftwin inspect` on recorded bags."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import numpy as np
import pytest

from arm_correction.reference import load_reference
from tof_core import se3
from tof_core.config import from_mapping
from tof_scene.builtin import make_builtin, write_builtin
from tof_virtual.config import VirtualConfig
from tof_virtual.record import record
from tof_virtual.robot import HAND_OF_CAMERA
from toftwin.cli import main
from toftwin.commands.simulate import bodies_of

if TYPE_CHECKING:
    from pathlib import Path


def recorded(folder: Path, name: str, *, without: str = "", **robot: float) -> tuple[Path, np.ndarray]:
    """One view of the body section; the robot's plan is the same in each, its base error is not. Also where the camera was."""
    plan = {"views": 1, "stations": 1, "captures": 6, "range_min_m": 0.6, "range_max_m": 0.7}
    config = from_mapping(VirtualConfig, {"plan": plan, "robot": robot, "camera": {"width": 160, "height": 120}, "seed": 2})
    bodies = [b for b in bodies_of(make_builtin("body_section")) if b.name != without]
    record(bodies, folder / name, config, truth_path=folder / f"{name}_truth")
    with np.load(folder / f"{name}_truth.npz") as truth:
        return folder / name, np.array(truth["T_cell_camera"][0])


@pytest.fixture(scope="module")
def bags(tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[Path, np.ndarray]]:
    folder = tmp_path_factory.mktemp("bags")
    return {
        "first": recorded(folder, "first", base_min_mm=0.0, base_max_mm=0.1),
        "later": recorded(folder, "later", base_min_mm=40.0, base_max_mm=45.0),
        "gone": recorded(folder, "gone", without="connector", base_min_mm=5.0, base_max_mm=10.0),
    }


def test_a_reference_and_the_cad_bring_the_hand_back(
    bags: dict[str, tuple[Path, np.ndarray]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (first, T_first), (later, T_later) = bags["first"], bags["later"]
    assert main(["correct", str(first), "--save", str(tmp_path / "ref"), "--scene", "body_section"]) == 0
    capsys.readouterr()
    assert main(["correct", str(later), "--reference", str(tmp_path / "ref"), "--scene", "body_section", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    for by in ("reference", "cad"):
        assert told[by]["verdict"] in ("accepted", "partial"), told[by]["reason"]
        delta = HAND_OF_CAMERA @ np.eye(4)
        camera_delta = se3.inverse(delta) @ se3.exp(told[by]["delta"]) @ delta
        metres, degrees = se3.distance(T_later @ camera_delta, T_first)
        assert 1e3 * metres < 3.0, by
        assert degrees < 0.3, by
    assert told["reference"]["frame"] == "body"
    assert told["reference"]["step_mm"] > 20


def test_without_a_reference_or_scene_the_call_is_wrong(
    bags: dict[str, tuple[Path, np.ndarray]], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["correct", str(bags["later"][0])]) == 2
    assert "--reference" in capsys.readouterr().err


def test_a_reference_of_another_scene_is_refused(
    bags: dict[str, tuple[Path, np.ndarray]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    first = bags["first"][0]
    assert main(["correct", str(first), "--save", str(tmp_path / "ref"), "--scene", "body_section"]) == 0
    assert main(["correct", str(first), "--reference", str(tmp_path / "ref"), "--scene", "pipework"]) == 1
    assert "another scene" in capsys.readouterr().err


def one_line(capsys: pytest.CaptureFixture[str]) -> str:
    said = capsys.readouterr().err
    assert said.count("\n") == 1, said
    assert "Traceback" not in said
    return said


def test_a_reference_of_another_camera_is_refused(
    bags: dict[str, tuple[Path, np.ndarray]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["correct", str(bags["first"][0]), "--save", str(tmp_path / "ref")]) == 0
    capsys.readouterr()
    other = tmp_path.parent / "other"
    plan = {"views": 1, "stations": 1, "captures": 2}
    record(
        bodies_of(make_builtin("body_section")), other, from_mapping(VirtualConfig, {"plan": plan, "camera": {"width": 112, "height": 84}})
    )
    assert main(["correct", str(other), "--reference", str(tmp_path / "ref")]) == 1
    assert "160x120" in one_line(capsys)


def test_an_invalid_reference_is_refused(
    bags: dict[str, tuple[Path, np.ndarray]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for command in ("correct", "inspect"):
        assert main([command, str(bags["later"][0]), "--reference", str(tmp_path / "none"), "--scene", "body_section"]) == 2
        refusal = one_line(capsys)
        assert "none: " in refusal
        assert "--save" in refusal


def test_only_a_region_may_matter(bags: dict[str, tuple[Path, np.ndarray]], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    first = str(bags["first"][0])
    assert main(["correct", first, "--save", str(tmp_path / "ref"), "--region", "10,20,100,60"]) == 0
    kept = load_reference(tmp_path / "ref").region
    assert kept.sum() == 6000
    assert kept[20:80, 10:110].all()
    capsys.readouterr()
    assert main(["correct", first, "--save", str(tmp_path / "ref"), "--region", "10,20"]) == 2
    assert "left,top,width,height" in one_line(capsys)
    assert main(["correct", first, "--save", str(tmp_path / "ref"), "--region", "0,0,10,10"]) == 1
    assert "pixels of the region have a depth" in one_line(capsys)


def test_a_view_that_the_bag_lacks_is_refused(
    bags: dict[str, tuple[Path, np.ndarray]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["correct", str(bags["first"][0]), "--save", str(tmp_path / "ref"), "--view", "7"]) == 2
    assert "there is no view 7; the bag has 1" in one_line(capsys)


def test_a_scene_without_parts_to_inspect_is_refused(
    bags: dict[str, tuple[Path, np.ndarray]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene = write_builtin("body_section", tmp_path)
    scene.write_text(scene.read_text().replace("inspect: true", "inspect: false"))
    assert main(["inspect", str(bags["gone"][0]), "--scene", str(scene)]) == 1
    assert "no part has `inspect: true`" in one_line(capsys)


def test_inspection_finds_the_part_that_is_gone(
    bags: dict[str, tuple[Path, np.ndarray]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["correct", str(bags["first"][0]), "--save", str(tmp_path / "ref"), "--scene", "body_section"]) == 0
    capsys.readouterr()
    flags = ["--scene", "body_section", "--reference", str(tmp_path / "ref"), "--out", str(tmp_path / "out"), "--json"]
    assert main(["inspect", str(bags["gone"][0]), *flags]) == 1
    said = capsys.readouterr()
    assert said.err.count("\n") == 1
    assert "has no colour picture" in said.err  # the bag had none: depth alone judges, and that is said
    told = json.loads(said.out)
    assert told["evidence"].startswith("depth alone")
    states = {p["name"]: p["state"] for p in told["parts"]}
    assert states["connector"] == "absent"
    assert sum(s == "absent" for s in states.values()) == 1
    assert (tmp_path / "out" / "inspection.html").read_text().count("connector") >= 1


def test_inspection_beside_a_session_of_the_complete_cell_keeps_its_history(
    bags: dict[str, tuple[Path, np.ndarray]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    history = tmp_path / "history"
    flags = ["--scene", "body_section", "--reference", str(bags["first"][0]), "--history", str(history)]
    complete = main(["inspect", str(bags["first"][0]), *flags])
    printed = capsys.readouterr().out
    assert complete == 0, "every part that is seen stands where it stood in the same bag"
    assert "0 displaced" in printed
    assert main(["inspect", str(bags["first"][0]), *flags, "--all-judged"]) == 1, "some parts are in no view"
    assert len(list(history.glob("*.json"))) == 1, "one file a session"
    two = ["--reference", str(bags["gone"][0])]
    capsys.readouterr()
    assert main(["inspect", str(bags["first"][0]), *flags, *two]) == 2
    assert "two reference sessions are given" in one_line(capsys)


def test_on_a_terminal_correct_and_inspect_show_how_far_they_are(
    bags: dict[str, tuple[Path, np.ndarray]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.stderr.isatty", lambda: True, raising=False)
    monkeypatch.setattr("tof_core.progress.DELAY_S", 0.0)
    first = str(bags["first"][0])
    assert main(["correct", first, "--save", str(tmp_path / "ref")]) == 0
    assert "captures:" in capsys.readouterr().err
    main(["inspect", first, "--scene", "body_section"])
    said = capsys.readouterr().err
    assert all(f"{step}:" in said for step in ("captures", "poses", "parts"))
    main(["inspect", first, "--scene", "body_section", "--quiet"])
    assert capsys.readouterr().err == ""
