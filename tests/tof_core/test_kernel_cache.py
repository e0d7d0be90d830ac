# SPDX-License-Identifier: Apache-2.0
"""A compiled kernel is renewed when a function or a constant that it imports has changed, and only then."""

from __future__ import annotations

import os
import subprocess
import sys
from typing import TYPE_CHECKING

import pytest

from tof_core import kernel_cache

if TYPE_CHECKING:
    from pathlib import Path

KERNEL = """
import tof_core
from numba import njit
from tof_tried.called import step
from tof_tried import constants

@njit(cache=True)
def value():
    return step() + constants.OFFSET
"""
CALLED = "from numba import njit\n\n@njit(cache=True)\ndef step():\n    return {}\n"


@pytest.fixture
def package(tmp_path: Path) -> Path:
    folder = tmp_path / "tof_tried"
    folder.mkdir()
    sources = {"__init__": "", "kernel": KERNEL, "called": CALLED.format(1), "constants": "OFFSET = 10\n", "other": "A = 1\n"}
    for name, text in sources.items():
        (folder / f"{name}.py").write_text(text)
    return folder


def called(package: Path) -> tuple[int, int]:
    """What the kernel returns in a process of its own, and how often it was taken from the cache."""
    code = "from tof_tried.kernel import value; print(value(), sum(value.stats.cache_hits.values()))"
    path = os.pathsep.join([str(package.parent), *sys.path])
    done = subprocess.run([sys.executable, "-c", code], env={**os.environ, "PYTHONPATH": path}, capture_output=True, text=True, check=True)
    result, hits = done.stdout.split()
    return int(result), int(hits)


def test_a_kernel_sees_an_edit_of_what_it_calls(package: Path) -> None:
    assert called(package) == (11, 0)
    assert called(package) == (11, 1)
    (package / "called.py").write_text(CALLED.format(2))
    assert called(package) == (12, 0)
    (package / "constants.py").write_text("OFFSET = 20\n")
    assert called(package) == (22, 0)
    (package / "other.py").write_text("A = 2\n")
    assert called(package) == (22, 1)


def test_files_of_other_packages_are_cached_by_numba(tmp_path: Path) -> None:
    foreign = tmp_path / "mine.py"
    foreign.write_text("")
    assert kernel_cache.root_of(foreign) is None
    assert kernel_cache.BesideSource.from_function(test_files_of_other_packages_are_cached_by_numba, str(foreign)) is None
