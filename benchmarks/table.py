# SPDX-License-Identifier: Apache-2.0
"""Figures as a table on the terminal, and as docs/figures.md, where rows of benches that did not run are kept."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping
    from pathlib import Path

    from benchmarks.figure import Figure

HEADER = """# Figures

Each row was printed by the command beside it, on the machine named in its section. `make bench` prints the short ones,
`make bench-long` the long ones; `ARGS=--write` renews this page, row by row. Terms: [glossary](glossary.md).
"""
COLUMNS = "| what | measured | bar | met | command | remark |\n|---|---|---|---|---|---|\n"
MET = {True: "yes", False: "**no**", None: ""}


def line(figure: Figure) -> str:
    """A figure as one line of the terminal's table."""
    verdict = {True: "met", False: "MISSED", None: ""}[figure.met]
    measured = f"{figure.value:.4g} {figure.unit}".rstrip()
    return f"  {figure.what:<72} {measured:>14}  {figure.bar:<24} {verdict:<7}{figure.remark}".rstrip()


def row(figure: Figure) -> str:
    """A figure as one row of the page."""
    cells = [figure.what, f"{figure.value:.4g} {figure.unit}".rstrip(), figure.bar, MET[figure.met], f"`{figure.command}`", figure.remark]
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |\n"


def read_sections(page: Path) -> dict[str, list[str]]:
    """Bench name to its note and rows, as the page has them now."""
    sections: dict[str, list[str]] = {}
    name = ""
    for text in page.read_text(encoding="utf-8").splitlines(keepends=True) if page.exists() else []:
        if text.startswith("## "):
            name = text[3:].strip()
            sections[name] = []
        elif name and text.strip() and not text.startswith(("| what |", "|---")):
            sections[name].append(text)
    return sections


def write_page(page: Path, results: Mapping[str, Iterable[Figure]], where: str) -> None:
    """Put new results in place of the same benches' old ones; every other section stays as it was."""
    sections = read_sections(page)
    for name, figures in results.items():
        sections[name] = [f"Measured {where}.\n", *(row(figure) for figure in figures)]
    text = HEADER
    for name, lines in sorted(sections.items()):
        notes = "".join(note for note in lines if not note.startswith("|"))
        rows = "".join(kept for kept in lines if kept.startswith("|"))
        text += f"\n## {name}\n\n{notes}\n{COLUMNS}{rows}"
    page.parent.mkdir(parents=True, exist_ok=True)
    page.write_text(text, encoding="utf-8")
