# SPDX-License-Identifier: Apache-2.0
"""The emerging camera shares no formula, ray caster or footprint with the rooms that it checks."""

from __future__ import annotations

import ast
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

PERMITTED = {"benchmarks.emerging", "tof_core", "tof_virtual"}


def test_it_imports_nothing_of_the_rooms_that_it_checks(repository: Path) -> None:
    rooms = {path.parent.name for path in (repository / "src").glob("*/__init__.py")} | {"benchmarks"}
    sources = sorted((repository / "benchmarks" / "emerging").glob("*.py"))
    assert len(sources) > 10
    imported = {
        name
        for source in sources
        for node in ast.walk(ast.parse(source.read_text(encoding="utf-8")))
        if isinstance(node, ast.Import | ast.ImportFrom)
        for name in ([node.module or ""] if isinstance(node, ast.ImportFrom) else [a.name for a in node.names])
    }
    own = {name for name in imported if name.partition(".")[0] in rooms}
    assert {name for name in own if not any(name == p or name.startswith(f"{p}.") for p in PERMITTED)} == set()
