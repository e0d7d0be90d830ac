# SPDX-License-Identifier: Apache-2.0
"""Cases of the gap check's short form: each is recorded and diagnosed once, by whichever test process comes to it first."""

from __future__ import annotations

import fcntl
import hashlib
from typing import TYPE_CHECKING

from benchmarks.gap_check import __main__ as gap_check
from benchmarks.gap_check.cases import draw, with_small_nulls
from benchmarks.gap_check.examine import examine_all
from benchmarks.gap_check.record import record_all
from benchmarks.gap_check.score import score_all
from tof_scene.builtin import builtin_names

if TYPE_CHECKING:
    from pathlib import Path

    import pytest

    from benchmarks.gap_check.score import Row

SEED = 40
COUNT, SIZE = gap_check.FORMS["short"]


def folder_of(config: pytest.Config, repository: Path) -> Path:
    """Where the cases are kept: a folder of these sources, so that a test that was stopped goes on where it was."""
    assert config.cache is not None
    sources = [*sorted((repository / "src").glob("tof_*")), repository / "src" / "toftwin", repository / "benchmarks" / "gap_check"]
    return config.cache.mkdir("gap-check") / digest(sources)


def digest(folders: list[Path]) -> str:
    """Of all sources in some folders: what other code has made is made again."""
    h = hashlib.sha256()
    for path in sorted(p for f in folders for p in f.rglob("*.py")):
        h.update(path.read_bytes())
    return h.hexdigest()[:16]


def scored(folder: Path, number: int) -> Row:
    """One case, recorded, diagnosed and scored; what is done is kept, and what another process has begun is waited for."""
    case = with_small_nulls(draw(COUNT, tuple(builtin_names()), SEED))[number]
    out = folder / case.name
    out.mkdir(parents=True, exist_ok=True)
    width, height = (int(x) for x in SIZE.split("x"))
    with (out / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        record_all([case], out, (width, height))
        examine_all(out)
        (row,) = score_all(out)
    return row
