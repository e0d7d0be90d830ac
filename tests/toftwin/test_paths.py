# SPDX-License-Identifier: Apache-2.0
"""A wrong path is refused in one line with exit code 2, before anything heavy is imported; nothing is written."""

from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path

import pytest

from tof_scene.builtin import builtin_names
from toftwin import cli
from toftwin.paths import BUILT_IN, FRESH, OUTPUTS, WRITTEN, session_name

HEAVY = ("numpy", "scipy", "numba", "cv2", "zarr", "yaml", "rclpy")
"""Packages that take longer to import than a wrong path may take to be refused."""
CALLS = {
    "bag": "label {no} --scene body_section --out {out}",
    "scene": "gap {yes} --scene {no} --out {out}",
    "settings": "inspect {yes} --scene body_section --config {no}",
    "sensor": "gap {yes} --scene body_section --sensor {no} --out {out}",
    "reference": "correct {yes} --scene body_section --reference {no}",
    "dataset": "train {no} --out {out}",
    "output below a file": "label {yes} --scene body_section --out {file}/out",
}


def parsed(call: str, folder: Path) -> tuple[list[str], Path]:
    """The arguments of a call, and the output it names."""
    (folder / "file").write_text("x")
    out = folder / "out"
    names = {"no": folder / "nowhere", "yes": folder, "file": folder / "file", "out": out}
    return call.format(**names).split(), out


@pytest.mark.parametrize("call", CALLS.values(), ids=CALLS)
def test_a_wrong_path_is_a_wrong_call(call: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments, out = parsed(call, tmp_path)
    assert cli.main(arguments) == 2
    printed = capsys.readouterr().err
    assert printed.count("\n") == 1
    assert "nowhere: does not exist; " in printed or "cannot be written: " in printed
    assert not out.exists()


@pytest.mark.parametrize("call", CALLS.values(), ids=CALLS)
def test_nothing_heavy_is_imported_before_a_wrong_path_is_refused(call: str, tmp_path: Path) -> None:
    arguments, _ = parsed(call, tmp_path)
    script = (
        f"import sys; from toftwin.cli import main; code = main({arguments!r}); print(code, *[m for m in {HEAVY!r} if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["2"]


PLACEHOLDERS = {"BAG", "FILE", "IDEAL", "SCENE", "SIMULATED"}
"""Placeholders of arguments that name a path and are read as text."""


def arguments(command: str) -> list[argparse.Action]:
    """Every argument of a command."""
    (commands,) = (a for a in cli.build_parser(command)._actions if isinstance(a, argparse._SubParsersAction))
    return list(commands.choices[command]._actions)


PATHS = [(name, a) for name in cli.command_names() for a in arguments(name) if a.type is Path or a.metavar in PLACEHOLDERS]


def is_output(command: str, name: str) -> bool:
    """Whether a command writes what this argument names."""
    return name in OUTPUTS and WRITTEN.get(name, command) == command


def call_with(command: str, action: argparse.Action, value: Path, folder: Path) -> list[str]:
    """A call with this value, and with something that is there for all else that the command demands."""
    words = [command]
    for other in arguments(command):
        if other.dest != action.dest and other.required:
            there = {"nodes": "preproc", "scene": "body_section", "out": str(folder / "new")}.get(other.dest, str(folder))
            words += [*other.option_strings[:1], there]
    return [*words, *action.option_strings[:1], str(value)]


@pytest.mark.parametrize(("command", "action"), PATHS, ids=[f"{name} {a.dest}" for name, a in PATHS])
def test_no_command_begins_with_a_wrong_path(
    command: str, action: argparse.Action, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").write_text("x")
    output = is_output(command, action.dest)
    wrong = tmp_path / ("file/out" if output else "nowhere")
    monkeypatch.setattr(cli.load_command(command), "run", lambda _: 0)
    assert cli.main(call_with(command, action, wrong, tmp_path)) == 2
    assert f"{wrong}: {'cannot be written' if output else 'does not exist'}" in capsys.readouterr().err


@pytest.mark.parametrize(("command", "name"), FRESH.items(), ids=FRESH)
def test_a_bag_that_exists_is_not_written_over(
    command: str, name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "bag").mkdir()
    (action,) = (a for a in arguments(command) if a.dest == name)
    monkeypatch.setattr(cli.load_command(command), "run", lambda _: 0)
    assert cli.main(call_with(command, action, tmp_path / "bag", tmp_path)) == 2
    assert f"{tmp_path / 'bag'}: exists already; name another folder or remove it" in capsys.readouterr().err
    assert (tmp_path / "bag").exists()


@pytest.mark.parametrize(("bag", "name"), [("monday/bag", "monday/bag"), ("monday/run_3", "run_3"), ("monday/run.mcap", "run.mcap")])
def test_a_session_is_named_by_its_bag_and_by_its_folder_where_that_says_nothing(bag: str, name: str) -> None:
    assert session_name(bag) == name


def test_built_in_scenes_are_known() -> None:
    assert set(BUILT_IN) == set(builtin_names())


@pytest.mark.parametrize(("word", "meant"), [("lable", "'label'"), ("Gap", "'gap'"), ("evaluat", "'evaluate'"), ("inspct", "'inspect'")])
def test_a_mistyped_command_gets_a_suggestion(word: str, meant: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main([word, "bag"]) == 2
    assert f"there is no command '{word}'; did you mean {meant}?" in capsys.readouterr().err


def test_a_word_like_no_command_gets_the_list(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["xyzzy"]) == 2
    assert "commands: correct, demo, doctor" in capsys.readouterr().err
