# SPDX-License-Identifier: Apache-2.0
"""Parts before a camera with wiggling and amplitude bias that nobody modelled: false displacements, found ones, honest sigmas."""

from __future__ import annotations

import shutil
import sys
import tempfile
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.biased_inspection.cases import draw, record_case
from benchmarks.biased_inspection.score import Row, score
from benchmarks.figure import Figure, at_least, at_most
from benchmarks.kept import kept
from tof_core.errors import RefusedError

if TYPE_CHECKING:
    from collections.abc import Callable

    from benchmarks.biased_inspection.cases import Case

LONG = True
COUNT, SEED = 16, 1000
"""Sessions of the bench; those that the limits were found on have seeds 800 and 900."""
OBSERVABLE_PX = 30
"""Distinctive pixels from which a part is observable."""


def run() -> list[Figure]:
    """The bars, both cameras together and each beside."""
    rows, refused = [], 0
    for case in draw(COUNT, SEED):
        found = kept(f"inspect-bias-{case.number}", lambda case=case: [asdict(r) for r in _measured(case)])  # type: ignore[misc]
        refused += not found
        rows += [Row(**row) for row in found]
    return figures(rows, refused)


def _measured(case: Case) -> list[Row]:
    """Record and inspect one session; none where it is refused."""
    folder = Path(tempfile.mkdtemp(prefix="toftwin-inspect-"))
    try:
        rows = score(case, record_case(case, folder), folder)
    except RefusedError as error:
        print(f"session {case.number}: {error}", file=sys.stderr, flush=True)
        return []
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    return rows


def figures(rows: list[Row], refused: int = 0) -> list[Figure]:
    """The bars over parts of all sessions."""
    judged = [r for r in rows if r.state in ("present", "displaced")]
    standing = [r for r in judged if r.truth == "present"]
    false = [r for r in standing if r.state == "displaced"]
    moved = [r for r in rows if r.truth == "displaced" and r.pixels >= OBSERVABLE_PX]
    found = [r for r in moved if r.state == "displaced"]
    gone = [r for r in rows if r.truth == "absent" and r.pixels >= OBSERVABLE_PX]
    missed = [r for r in gone if r.state in ("present", "displaced")]
    errors = np.array([e for r in judged for e in r.errors])
    honest = 100 * float((np.abs(errors) <= 2).mean()) if len(errors) else float("nan")
    sessions = f"{len({r.case for r in rows})} sessions" + (f", {refused} more refused" if refused else "")
    unsure = [r for r in standing if "cannot be judged" in r.why]
    return [
        at_most("inspection, unmodelled bias: parts in place called displaced", 100 * len(false) / max(len(standing), 1), 1, "%",
                remark=f"{len(false)} of {len(standing)}; {_each(standing, lambda r: r.state == 'displaced')}; {sessions}"),
        at_least("inspection, unmodelled bias: displacements of 5 mm and more that are found", 100 * len(found) / max(len(moved), 1), 90, "%",
                 remark=f"{len(found)} of {len(moved)}; {_each(moved, lambda r: r.state == 'displaced')}"),
        Figure("inspection, unmodelled bias: errors of the displacement within 2 of its sigmas", honest, "%", "92 to 98 %", 92 <= honest <= 98,
               remark=f"{len(errors)} axes along which the place is known; median error {np.median([abs(r.displaced_mm - r.moved_mm) for r in judged if r.errors and r.truth != 'absent'] or [np.nan]):.2f} mm"),
        Figure("inspection, unmodelled bias: parts in place whose tolerance cannot be judged", 100 * len(unsure) / max(len(standing), 1), "%",
               remark=f"{len(unsure)} of {len(standing)}"),
        Figure("inspection, unmodelled bias: absent parts called present or displaced", 100 * len(missed) / max(len(gone), 1), "%", remark=f"{len(missed)} of {len(gone)}"),
    ]  # fmt: skip


def _each(rows: list[Row], is_so: Callable[[Row], bool]) -> str:
    """Counts of each camera."""
    cameras = sorted({r.camera for r in rows})
    return ", ".join(
        f"{camera} {sum(is_so(r) for r in rows if r.camera == camera)} of {sum(r.camera == camera for r in rows)}" for camera in cameras
    )
