# SPDX-License-Identifier: Apache-2.0
"""Second process: `toftwin gap REAL --against SIMULATED` on the bags alone."""

from __future__ import annotations

import time
from contextlib import redirect_stderr, redirect_stdout
from typing import TYPE_CHECKING

from benchmarks.against.record import REAL, SIMULATED
from benchmarks.gap_check.examine import DATA_SHEET, REPORTS
from benchmarks.gap_check.record import BAGS
from tof_core.progress import progress

if TYPE_CHECKING:
    from pathlib import Path

CODE = "exit.txt"


def compare_pairs(folder: Path) -> None:
    """The command's output per pair under `reports/`; done ones are kept."""
    pairs = sorted((folder / BAGS).iterdir())
    for pair in progress(pairs, "comparing pairs", len(pairs)):
        out = folder / REPORTS / pair.name
        if not (out / CODE).exists():
            compare(pair, out)


def compare(pair: Path, out: Path) -> None:
    """One call of the command, with what it prints and its exit code: a refusal is an answer too."""
    from toftwin.cli import main

    out.mkdir(parents=True, exist_ok=True)
    scene = pair / "scene"
    words = ["gap", str(pair / REAL), "--scene", str(scene / "scene.yaml"), "--sensor", str(scene / DATA_SHEET)]
    busy = time.process_time()
    with (out / "printed.txt").open("w") as printed, redirect_stdout(printed), redirect_stderr(printed):
        code = main([*words, "--against", str(pair / SIMULATED), "--out", str(out)])
    (out / CODE).write_text(f"{code} {time.process_time() - busy:.1f}\n")
