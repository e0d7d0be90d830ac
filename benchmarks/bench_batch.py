# SPDX-License-Identifier: Apache-2.0
"""Labelling many bags: what a second worker brings, and what a view costs in seconds and bytes (docs/scale.md reckons with these)."""

from __future__ import annotations

import resource
import shutil
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING

from benchmarks.figure import Figure, at_least
from benchmarks.recorded import recorded
from toftwin.batch_engines import run_local
from toftwin.label_call import LabelCall
from toftwin.pipeline import PipelineConfig

if TYPE_CHECKING:
    from toftwin.label_call import Outcome

BAGS, VIEWS, CAPTURES = 6, 8, 10
SESSION = {"plan": {"views": VIEWS, "stations": 2, "captures": CAPTURES}, "camera": {"width": 224, "height": 171}, "seed": 5}


def run() -> list[Figure]:
    """Every figure of this room."""
    bag = recorded("body_section", SESSION).bag
    with tempfile.TemporaryDirectory(prefix="toftwin-bench-") as folder:
        work = Path(folder)
        names = [str(shutil.copytree(bag, work / f"bag{i}")) for i in range(BAGS)]
        one, took_one, processor = timed([call(name, work / "one") for name in names], 1)
        _, took_two, _ = timed([call(name, work / "two") for name in names], 2)
        bag_mb = sum(p.stat().st_size for p in Path(names[0]).rglob("*")) / 1e6
    views = BAGS * VIEWS
    spread = f"{BAGS} bags of {VIEWS} views of {CAPTURES} captures, 224x171, one core a worker, start of the processes included"
    return [
        at_least("batch: two workers against one", took_one / took_two, 1.8, "", remark=f"{spread}; {took_one:.1f} s and {took_two:.1f} s"),
        Figure(
            "batch: seconds of processor a view", processor / views, "s", remark=f"{took_one / views:.2f} s on the wall with one worker"
        ),
        Figure(
            "batch: bag, bytes a view",
            bag_mb / VIEWS,
            "MB",
            remark="16UC1 depth, mono16 amplitude, TF at 50 Hz; MCAP as the virtual robot writes it",
        ),
        Figure("batch: dataset, bytes a view", one[0].megabytes / VIEWS, "MB", remark="captures and views, as Zarr chunks"),
    ]


def timed(calls: list[LabelCall], workers: int) -> tuple[list[Outcome], float, float]:
    """All outcomes, the seconds that they took together, and those of processor (which a busy machine does not stretch)."""
    start, before = time.perf_counter(), processor_s()
    outcomes = list(run_local(calls, workers))
    took = time.perf_counter() - start
    failed = [o.error for o in outcomes if o.error]
    if failed:
        raise RuntimeError(failed[0])
    return outcomes, took, processor_s() - before


def processor_s() -> float:
    """Of all processes that were started here and have ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def call(bag: str, out: Path) -> LabelCall:
    """`toftwin label BAG` as the command line makes it."""
    return LabelCall(bag, Path("body_section"), out / Path(bag).name, PipelineConfig())
