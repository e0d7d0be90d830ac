# SPDX-License-Identifier: Apache-2.0
"""The command line: instant help, one line per error, exit codes."""

from __future__ import annotations

import errno
import re
import resource
import subprocess
import sys
from pathlib import Path

import pytest

from tof_core.errors import BagError, ConfigError
from toftwin import cli, faults


def test_help_lists_every_command_and_starts_at_once() -> None:
    """0.3 s on a free core; processor time, since other tests run beside this one."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    shown = subprocess.run([sys.executable, "-m", "toftwin.cli", "--help"], capture_output=True, text=True, check=True).stdout
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    assert all(re.search(rf"^    {cli.load_command(name).NAME}\b", shown, re.MULTILINE) for name in cli.command_names())
    assert after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime < 0.3


def test_help_imports_nothing_heavy() -> None:
    code = "import sys, toftwin.cli as c; c.main(['--help']); print(sorted({m.split('.')[0] for m in sys.modules}))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = done.stdout.splitlines()[-1]
    assert not [m for m in ("numpy", "numba", "rclpy", "open3d", "torch", "trimesh", "matplotlib", "cv2", "zarr") if f"'{m}'" in loaded]


@pytest.mark.parametrize("name", cli.command_names())
def test_every_command_has_help_with_an_example(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main([name, "--help"]) == 0
    out = capsys.readouterr().out
    assert "example:" in out
    assert f"toftwin {name}" in out.partition("example:")[2]


def test_a_wrong_call_exits_2(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["no-such-command"]) == 2
    assert "no-such-command" in capsys.readouterr().err
    assert cli.main([]) == 2


def test_known_errors_are_one_line_with_their_exit_code(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.report(BagError("has no CameraInfo", where="bag", todo="name it with --info-topic")) == 1
    assert capsys.readouterr().err == "toftwin: bag: has no CameraInfo; name it with --info-topic\n"
    assert cli.report(ConfigError("unknown key\n'x'")) == 2
    assert capsys.readouterr().err == "toftwin: unknown key 'x'\n"


def test_a_mistyped_command_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["lable", "bag"]) == 2
    assert capsys.readouterr().err == "toftwin: there is no command 'lable'; did you mean 'label'?\n"


def test_the_page_lists_every_exit_code() -> None:
    """What docs/commands.md says is what the error tree and the faults return."""
    codes = {cli.report(BagError("x")), cli.report(ConfigError("x")), faults.EXIT_BUG, faults.EXIT_INTERRUPTED}
    text = (Path(__file__).parents[2] / "docs/commands.md").read_text()
    line = text[text.index("Exit codes:") :].partition(".")[0]
    assert {int(n) for n in re.findall(r"\b\d+\b", line)} == codes | {0}


def test_a_full_disk_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.report(OSError(errno.ENOSPC, "No space left on device", "out/x")) == 1
    assert capsys.readouterr().err.startswith("toftwin: out/x: the disk is full;")


def test_a_fault_of_ours_names_the_file_with_its_traceback(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    assert cli.report(KeyError("oops")) == faults.EXIT_BUG
    line = capsys.readouterr().err
    assert line.count("\n") == 1
    assert "KeyError: 'oops'" in next(tmp_path.glob("toftwin-*.log")).read_text()
    assert str(tmp_path) in line


def test_stopping_says_that_work_is_kept(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.report(KeyboardInterrupt()) == faults.EXIT_INTERRUPTED
    assert "kept" in capsys.readouterr().err
