# SPDX-License-Identifier: Apache-2.0
"""Answers are sealed once, and an answer that was changed afterwards is refused."""

from __future__ import annotations

from types import SimpleNamespace
from typing import TYPE_CHECKING

import pytest

from benchmarks.gap_check.record import opened, record_sealed, sealed_names
from tof_core.errors import DatasetError

if TYPE_CHECKING:
    from pathlib import Path

CASES = [SimpleNamespace(name="b"), SimpleNamespace(name="a")]


def test_a_case_is_recorded_once_and_again_where_its_last_file_is_missing(tmp_path: Path) -> None:
    recorded = []

    def record(case: SimpleNamespace, bags: Path, sealed: Path) -> None:
        recorded.append(case.name)
        (bags / "bag").mkdir(parents=True)
        sealed.mkdir(parents=True)
        (sealed / "case.json").write_text(f"answer {case.name}")

    record_sealed(CASES, tmp_path, "bag", record)
    (tmp_path / "bags" / "a" / "bag").rmdir()
    record_sealed(CASES, tmp_path, "bag", record)
    assert recorded == ["b", "a", "a"]
    assert sealed_names(tmp_path) == ["a", "b"]
    assert (opened(tmp_path, "a") / "case.json").read_text() == "answer a"
    (tmp_path / "sealed" / "b" / "case.json").write_text("another answer")
    with pytest.raises(DatasetError, match="was changed after it was sealed"):
        opened(tmp_path, "b")
