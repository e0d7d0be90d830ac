# SPDX-License-Identifier: Apache-2.0
"""The commit-msg hook: what it refuses, what it lets pass, and that pre-commit calls it."""

from __future__ import annotations

import subprocess
import sys
from typing import TYPE_CHECKING

import pytest
import yaml

import check_subject

if TYPE_CHECKING:
    from pathlib import Path

LONGEST = "core: " + 66 * "x"


@pytest.mark.parametrize(
    "message",
    [
        "core: groups by keys",
        LONGEST,
        LONGEST + "\n\n" + 200 * "a body may have long lines ",
        "core: groups\n# Please enter the commit message\n# second comment",
        "Merge branch 'main' into " + 80 * "x",
    ],
)
def test_a_good_message_passes(message: str) -> None:
    assert check_subject.fault(message) == ""


@pytest.mark.parametrize(
    ("message", "why"),
    [
        (LONGEST + "y", "73 characters, 72 at most"),
        ("", "no subject"),
        ("\ncore: groups", "no subject"),
        ("# only a comment", "no subject"),
        ("core: groups\nbody at once", "second line"),
    ],
)
def test_a_bad_message_is_refused_with_the_reason(message: str, why: str) -> None:
    assert why in check_subject.fault(message)


def test_the_hook_refuses_by_its_exit_code(repository: Path, tmp_path: Path) -> None:
    (tmp_path / "MESSAGE").write_text(LONGEST + "y", encoding="utf-8")
    script = repository / "scripts" / "check_subject.py"
    done = subprocess.run([sys.executable, script, tmp_path / "MESSAGE"], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (1, "")
    assert "73 characters" in done.stderr


def test_pre_commit_calls_it(repository: Path) -> None:
    config = yaml.safe_load((repository / ".pre-commit-config.yaml").read_text())
    (hook,) = [h for repo in config["repos"] for h in repo["hooks"] if h.get("stages") == ["commit-msg"]]
    assert hook["entry"].split()[-1] == "scripts/check_subject.py"
    assert (repository / hook["entry"].split()[-1]).is_file()
    assert "commit-msg" in config["default_install_hook_types"]
