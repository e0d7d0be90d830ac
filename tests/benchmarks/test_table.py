# SPDX-License-Identifier: Apache-2.0
"""The page of figures renews what ran and keeps what did not."""

from __future__ import annotations

from typing import TYPE_CHECKING

from benchmarks.figure import Figure, at_least, at_most
from benchmarks.table import line, read_sections, write_page

if TYPE_CHECKING:
    from pathlib import Path


def test_a_figure_meets_its_bar_from_the_right_side() -> None:
    assert at_most("label error", 0.01, 0.01, "mm").met is True
    assert at_most("label error", 0.011, 0.01, "mm").met is False
    assert at_least("rate", 5.0, 5.0, "1/s").met is True
    assert at_least("rate", 4.9, 5.0, "1/s").met is False
    assert at_most("label error", float("nan"), 0.01, "mm").met is False


def test_a_missed_bar_is_loud() -> None:
    assert "MISSED" in line(at_most("label error", 0.02, 0.01, "mm"))
    assert "MISSED" not in line(at_most("label error", 0.002, 0.01, "mm"))


def test_rows_of_benches_that_did_not_run_are_kept(tmp_path: Path) -> None:
    page = tmp_path / "docs" / "figures.md"
    write_page(page, {"rays": [Figure("rate", 6.2, "M/s", command="a")], "sor": [Figure("f1", 0.95, "", command="b")]}, "yesterday")
    write_page(page, {"rays": [Figure("rate", 7.5, "M/s", command="a"), Figure("loss | gain", 0.0, "", command="c")]}, "today")
    sections = read_sections(page)
    assert list(sections) == ["rays", "sor"]
    assert [text.split(" | ")[1] for text in sections["rays"][1:]] == ["7.5 M/s", "0"]
    assert sections["rays"][0] == "Measured today.\n"
    assert sections["sor"] == ["Measured yesterday.\n", "| f1 | 0.95 |  |  | `b` |  |\n"]


def test_writing_the_same_page_twice_changes_nothing(tmp_path: Path) -> None:
    page = tmp_path / "figures.md"
    write_page(page, {"rays": [at_most("error", 0.004, 0.01, "mm")]}, "today")
    before = page.read_text()
    write_page(page, {"rays": [at_most("error", 0.004, 0.01, "mm")]}, "today")
    assert page.read_text() == before
