# SPDX-License-Identifier: Apache-2.0
"""docs/pains.md: each of the fifteen pains and every fault names its tests, and those exist."""

from __future__ import annotations

import ast
import re
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from pathlib import Path


@pytest.fixture(scope="module")
def rows(repository: Path) -> list[tuple[int, list[str]]]:
    text = (repository / "docs" / "pains.md").read_text()
    found = re.findall(r"^\| (\d+) \|.*\| ([^|]+) \|$", text, re.MULTILINE)
    return [(int(number), re.findall(r"`([^`]+)`", tests)) for number, tests in found]


def test_there_are_fifteen_and_each_has_a_test(rows: list[tuple[int, list[str]]]) -> None:
    assert [number for number, _ in rows] == list(range(1, 16))
    assert all(len(tests) >= 2 for _, tests in rows)


def test_every_test_that_is_named_exists(repository: Path) -> None:
    named = re.findall(r"`(tests/[^`]+)`", (repository / "docs" / "pains.md").read_text().replace("`tests/docs/test_pains.py`", ""))
    assert len(named) >= 15 * 2 + 14
    for name in named:
        path, _, function = name.partition("::")
        tree = ast.parse((repository / path).read_text())
        assert function in {node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)}, name
