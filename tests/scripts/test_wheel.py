# SPDX-License-Identifier: Apache-2.0
"""The wheel and the sdist hold all that the commands need: tried outside the checkout, with toftwin from the wheel alone."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tarfile
import zipfile
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from pathlib import Path

DATA = ("py.typed", ".yaml", ".j2", ".css", ".onnx", ".xml")
"""Ends of the files beside the modules that travel with them."""


@pytest.fixture(scope="module")
def built(repository: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the wheel and the sdist, made from a copy of the checkout without its environment."""
    pytest.importorskip("setuptools", minversion="77", reason="the build needs the setuptools that pyproject.toml names")
    copy, out = tmp_path_factory.mktemp("copy") / "toftwin", tmp_path_factory.mktemp("dist")
    kept = ("src", "pyproject.toml", "README.md", "LICENSE", "NOTICE")
    copy.mkdir()
    for name in kept:
        source = repository / name
        ignored = shutil.ignore_patterns("__pycache__", "*.egg-info", "*.nbc", "*.nbi")
        shutil.copytree(source, copy / name, ignore=ignored) if source.is_dir() else shutil.copy(source, copy / name)
    code = f"from setuptools import build_meta as b; b.build_wheel({str(out)!r}); b.build_sdist({str(out)!r})"
    done = subprocess.run([sys.executable, "-c", code], cwd=copy, check=False, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-2000:]
    return out


@pytest.mark.slow
def test_wheel_and_sdist_hold_every_data_file(built: Path, repository: Path) -> None:
    wanted = {
        p.relative_to(repository / "src").as_posix()
        for p in (repository / "src").rglob("*")
        if p.is_file() and p.name.endswith(DATA) and "egg-info" not in p.as_posix()
    }
    assert len(wanted) > 20
    (wheel,), (sdist,) = built.glob("*.whl"), built.glob("*.tar.gz")
    assert wanted - set(zipfile.ZipFile(wheel).namelist()) == set()
    with tarfile.open(sdist) as archive:
        held = {name.partition("/src/")[2] for name in archive.getnames()}
    assert wanted - held == set()


@pytest.mark.slow
def test_the_wheels_commands_run_outside_the_checkout(built: Path, tmp_path: Path) -> None:
    (wheel,) = built.glob("*.whl")
    site, away = tmp_path / "site", tmp_path / "away"
    away.mkdir()
    zipfile.ZipFile(wheel).extractall(site)  # noqa: S202 (built here)
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"} | {"PYTHONPATH": str(site)}

    def run(*arguments: str) -> str:
        command = [sys.executable, "-m", "toftwin.cli", *arguments]
        done = subprocess.run(command, cwd=away, env=environment, check=False, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        return done.stdout

    where = subprocess.run(
        [sys.executable, "-c", "import toftwin; print(toftwin.__file__)"],
        cwd=away,
        env=environment,
        check=True,
        capture_output=True,
        text=True,
    )
    assert where.stdout.startswith(str(site)), "it is the wheel that is tried"
    assert "usage: toftwin" in run("--help")
    assert "reach_m" in run("correct", "--settings")
