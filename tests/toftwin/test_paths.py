# SPDX-License-Identifier: Apache-2.0
"""A wrong path is refused in one line with exit code 2, before anything heavy is imported; nothing is written."""

from __future__ import annotations

import subprocess
import sys
from typing import TYPE_CHECKING

import pytest

from tof_scene.builtin import builtin_names
from toftwin import cli
from toftwin.paths import BUILT_IN

if TYPE_CHECKING:
    from pathlib import Path

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


def test_built_in_scenes_are_known() -> None:
    assert set(BUILT_IN) == set(builtin_names())


@pytest.mark.parametrize(("word", "meant"), [("lable", "'label'"), ("Gap", "'gap'"), ("evaluat", "'evaluate'"), ("inspct", "'inspect'")])
def test_a_mistyped_command_gets_a_suggestion(word: str, meant: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main([word, "bag"]) == 2
    assert f"there is no command '{word}'; did you mean {meant}?" in capsys.readouterr().err


def test_a_word_like_no_command_gets_the_list(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["xyzzy"]) == 2
    assert "commands: correct, demo, doctor" in capsys.readouterr().err
