# SPDX-License-Identifier: Apache-2.0
"""docs/limits.md: every number that decides a diagnosis or an alignment, and what changes when it is halved and doubled."""

from __future__ import annotations

import json
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tof_align.config import AlignConfig
from tof_core.config import table
from tof_gap.config import GapConfig

if TYPE_CHECKING:
    from tof_core.config import ParamInfo

MEASURED = Path(__file__).resolve().parent.parent / "benchmarks" / "limits.json"
SECTIONS: dict[str, type[Any]] = {"gap": GapConfig, "align": AlignConfig}
TITLES = {"gap": "The diagnosis", "align": "The alignment"}
INTRODUCTION = """# Every number that decides

`toftwin gap` and `toftwin label` decide by the numbers below. Each is a setting: `toftwin gap --settings` lists them, and `--set NAME=VALUE` or
`--config FILE.yaml` changes them. `gap.` is the diagnosis, `align.` the alignment that it and every label use. Terms are in the [glossary](glossary.md).

**Halved, doubled**: what changes when the number is halved or doubled and all others keep their defaults. For the diagnosis, in how many of the
sessions that were tried the verdict changes, and by how many percentage points the shrink, its interval or the explainable share changes at most. For
the alignment, in how many sessions another number of views is accepted, and by how many millimetres a camera moves at most. *Not read*: no session that was tried depends on the number,
such as those of motion blur where all views are still. A dash: the number states something of the camera or seeds a draw, and decides nothing by itself.
A bound of the number may hold the value nearer to the default. A star: measured in smaller sessions. The columns do not count what is reported
of the world (parts that are missing, objects that the CAD lacks): numbers of `gap.world` change that first.

`.venv/bin/python -m benchmarks.limits --write` measures: it records twelve sessions of 160x122 pixels (two nulls, single effects, a pair, one effect
withheld from the list), or takes those of `--bags`, and goes on where it stopped. `--only gap.noise` measures some of the numbers, `--missing` those
without a row, `--views` and `--size` in smaller sessions, `--filter "3 x 3"` in sessions whose depth images passed a denoising filter, and `--surprise 7`
in one with an object that the CAD lacks and a person's arm.
"""


def page() -> str:
    """The whole page."""
    measured = json.loads(MEASURED.read_text(encoding="utf-8"))
    rows = {row["name"]: row for row in measured["rows"]}
    parts = [INTRODUCTION.strip(), _state(measured)]
    for prefix, cls in SECTIONS.items():
        numbers = [info for info in table(cls) if info.kind in (int, float)]
        parts += [f"## {TITLES[prefix]}"]
        for (group, section), members in groupby(numbers, key=lambda info: (info.group, info.section)):
            lines = [_line(f"{prefix}.{info.name}", info, rows) for info in members]
            about = [f"{section[0].upper()}{section[1:]}."] if section else []
            parts += [f"### `{prefix}{'.' + group if group else ''}`", *about, "\n".join([HEAD, *lines])]
    return "\n\n".join(parts) + "\n"


HEAD = "| number | default | unit | bounds | meaning | reason | halved | doubled |\n|---|---|---|---|---|---|---|---|"


def _state(measured: dict[str, Any]) -> str:
    """How many numbers are measured, at which commits, on what."""
    rows = measured["rows"]
    commits = ", ".join(sorted({row["code"] for row in rows}))
    smaller = [row["size"] for row in rows if "size" in row]
    stars = "; ".join(f"{smaller.count(size)} in sessions of {size}" for size in dict.fromkeys(smaller))
    return f"Measured: {len(rows)} numbers, at commits {commits} ({measured['measured']}), each in as many sessions as its cells state. With a star: {stars or 'none'}."


def _line(name: str, info: ParamInfo, rows: dict[str, Any]) -> str:
    low, high = ("" if v is None else f"{v:g}" for v in (info.low, info.high))
    row = rows.get(name)
    unit = "mm" if name.startswith("align.") else "points"
    changes = [_change(row, key, unit) for key in ("halved", "doubled")]
    cells = (f"`{info.name.rpartition('.')[2]}`", f"{info.default:g}", info.unit, f"{low} .. {high}", info.text, info.why, *changes)
    return f"| {' | '.join(cell.replace('|', '/') for cell in cells)} |"


def _change(row: dict[str, Any] | None, key: str, unit: str) -> str:
    """What a changed number changes, in a cell."""
    if row is None:
        return "–"
    if row["read"] == 0:
        return "not read" + (" *" if "size" in row else "")
    found = row[key]
    if found is None:
        return "at its bound"
    most = f", {found['most']:.2g} {unit}" if found["most"] >= 0.05 else ""
    return f"{found['changed']} of {row['sessions']}{most}{' *' if 'size' in row else ''}"
