# SPDX-License-Identifier: Apache-2.0
"""Results of the trials: one line each while they are made, one row per number in the end."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

from benchmarks.limits.names import FACTORS, SECTIONS, numbers

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path


USUAL_SIZE = "12 views of 160x122 pixels"


def read(path: Path) -> list[dict[str, Any]]:
    """The lines so far; a last one that was cut off is left out."""
    out = []
    for line in path.read_text().splitlines() if path.exists() else []:
        try:
            out.append(json.loads(line))
        except ValueError:
            break
    return out


def key(line: dict[str, Any]) -> tuple[Any, ...]:
    """What a line is about."""
    return line["code"], line["session"], line["name"], line["factor"]


def rows(lines: Iterable[dict[str, Any]]) -> list[dict[str, Any]]:
    """One row per number: sessions tried, their size where it is not the usual one, sessions that read it; per factor, verdicts that change and the largest change of a figure.

    Of a number that was measured at several commits, the last one counts.
    """
    by_name: dict[str, list[dict[str, Any]]] = {}
    for line in lines:
        by_name.setdefault(line["name"], []).append(line)
    return [
        _row(name, [line for line in by_name[name] if line["code"] == by_name[name][-1]["code"]])
        for of in SECTIONS
        for info in numbers(of)
        if (name := f"{of}.{info.name}") in by_name
    ]


def renewed(before: Iterable[dict[str, Any]], measured: Iterable[dict[str, Any]]) -> list[dict[str, Any]]:
    """The rows of a table, replaced where they were measured again, in the order of `--settings`; numbers that no longer exist are dropped."""
    by_name = {row["name"]: row for row in (*before, *measured)}
    return [by_name[name] for of in SECTIONS for info in numbers(of) if (name := f"{of}.{info.name}") in by_name]


def _row(name: str, lines: list[dict[str, Any]]) -> dict[str, Any]:
    tried = {line["session"] for line in lines}
    row: dict[str, Any] = {"name": name, "sessions": len(tried), "read": len({line["session"] for line in lines if line["read"]})}
    row["code"] = max({line["code"] for line in lines})
    if (size := lines[0].get("size", USUAL_SIZE)) != USUAL_SIZE:
        row["size"] = size
    for factor in FACTORS:
        mine = [line for line in lines if line["factor"] == factor and line["value"] is not None]
        figures = [f for line in mine if (f := line.get("points", line.get("mm"))) is not None]
        row["halved" if factor < 1 else "doubled"] = (
            {
                "value": mine[0]["value"],
                "changed": sum(line.get("changed", False) for line in mine),
                "most": max(figures, default=0.0),
                "sessions": sorted(line["session"] for line in mine if line.get("changed")),
            }
            if mine
            else None
        )
    return row


def text(row: dict[str, Any]) -> str:
    """A row for a terminal."""
    unit = "mm" if row["name"].startswith("align.") else "points"
    cells = [
        f"{what}: {found['changed']} of {row['sessions']} change, at most {found['most']:.2g} {unit}"
        for what in ("halved", "doubled")
        if (found := row[what]) is not None
    ]
    return f"{row['name']:<40} read in {row['read']:>2} of {row['sessions']:>2}; " + "; ".join(cells)
