# SPDX-License-Identifier: Apache-2.0
"""Commands on a busy host: alone, and beside four processes that never wait, against the share of the cores that is theirs."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
import time
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from benchmarks.figure import Figure, at_most
from benchmarks.recorded import recorded
from benchmarks.soak import busy_s
from tof_core.cores import CORES, ONE_THREAD

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

LONG = True
SCENE = "body_section"
SESSION = {"plan": {"views": 4, "stations": 4, "captures": 2}, "seed": 6}
STREAM = {"plan": {"views": 2, "stations": 1, "captures": 60}, "seed": 6}
"""For the network, whose start takes as long as a hundred frames."""
NEIGHBOURS = 4
BAR = 1.5
"""Slower than the fair share by this factor at most."""
ONE_THREADED = [sys.executable, "-S", "-c", "sum(i * i for i in range(40_000_000))"]
"""Computes for some seconds and never waits."""


@dataclass(frozen=True, slots=True)
class Spent:
    """What a command took: seconds on the wall and of processor; `others` is cores that all processes not started here used."""

    wall: float
    busy: float
    others: float

    @property
    def threads(self) -> float:
        """Threads of the command that ran, on average."""
        return self.busy / self.wall


def run() -> list[Figure]:
    """Each command alone, then beside its neighbours; the first call of each, which fills caches, does not count."""
    with tempfile.TemporaryDirectory(prefix="toftwin-bench-") as folder:
        figures = []
        for name, arguments in commands(Path(folder)).items():
            figures.append(figure(name, arguments, Path(folder)))
            print(f"  {name}: {figures[-1].value:.2f}; {figures[-1].remark}", file=sys.stderr, flush=True)
        return figures


def commands(folder: Path) -> dict[str, list[str]]:
    """What is measured, by name; `{out}` is a path of its own for each call. Training learns from what label wrote."""
    bag = str(recorded(SCENE, SESSION).bag)
    return {
        "label": ["label", bag, "--scene", SCENE, "--out", "{out}", "--quiet"],
        "train": ["train", str(folder / "label0"), "--out", "{out}.onnx", "--epochs", "4", "--quiet"],
        "gap": ["gap", bag, "--scene", SCENE, "--out", "{out}", "--quiet"],
        "infer": ["infer", str(recorded(SCENE, STREAM).bag), "--out", "{out}", "--quiet"],
        "the graph": ["replay", bag, "--scene", SCENE, "--quiet"],
    }


def figure(name: str, arguments: list[str], folder: Path) -> Figure:
    """How much more than its fair share neighbours slow a command down; one thread that only computes is measured beside it."""
    calls = [toftwin(a.replace("{out}", str(folder / f"{name}{i}")) for a in arguments) for i in range(3)]
    spent(calls[0], [])
    alone, one_alone = spent(calls[1], []), spent(ONE_THREADED, [])
    with neighbours() as spinning:
        beside, one_beside = spent(calls[2], spinning), spent(ONE_THREADED, spinning)
    fair = fair_slowdown(alone, one_beside.wall / one_alone.wall)
    remark = (
        f"{alone.wall:.1f} s alone, {beside.wall:.1f} s beside them, fair {fair * alone.wall:.1f} s; processor {alone.busy:.1f} and "
        f"{beside.busy:.1f} s; one thread that only computes slows by {one_beside.wall / one_alone.wall:.2f}; "
        f"other processes {alone.others:.2f} and {beside.others:.2f} cores"
    )
    what = f"{name} beside {NEIGHBOURS} spinning processes on {CORES} cores, time over its fair share of them"
    return at_most(what, beside.wall / (fair * alone.wall), BAR, "", remark=remark)


def fair_slowdown(alone: Spent, one: float) -> float:
    """By how much neighbours may slow a command down where every runnable thread has the same share of the cores.

    With t threads and n neighbours on c cores each thread has c / (t + n) of a core, so that it takes (t + n) / c times as long. `one`
    is the slowdown that was measured for t = 1, which other processes of the host have entered, too.
    """
    return one * (max(alone.threads, 1.0) + NEIGHBOURS) / (1.0 + NEIGHBOURS)


def toftwin(arguments: Iterable[str]) -> list[str]:
    """The command line of a command."""
    return [sys.executable, "-m", "toftwin.cli", *arguments]


def spent(command: list[str], spinning: list[subprocess.Popen[bytes]]) -> Spent:
    """Run a command, with the threads that it gives itself."""
    environment = {name: value for name, value in os.environ.items() if name not in ONE_THREAD}
    before, all_before, theirs, began = processor_s(), busy_s(), used_s(spinning), time.monotonic()
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    wall, busy = time.monotonic() - began, processor_s() - before
    if done.returncode:
        raise RuntimeError(f"{' '.join(command[2:4])}: {done.stderr.strip()[-200:]}")
    return Spent(wall, busy, max(busy_s() - all_before - busy - used_s(spinning) + theirs, 0.0) / wall)


def processor_s() -> float:
    """Of all processes that were started here and have ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def used_s(processes: list[subprocess.Popen[bytes]]) -> float:
    """Processor time of processes that run."""
    lines = [Path(f"/proc/{p.pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split() for p in processes]
    return sum(int(fields[11]) + int(fields[12]) for fields in lines) / os.sysconf("SC_CLK_TCK")


@contextmanager
def neighbours() -> Iterator[list[subprocess.Popen[bytes]]]:
    """Processes that never wait, while the block runs."""
    processes = [subprocess.Popen([sys.executable, "-S", "-c", "while True: pass"]) for _ in range(NEIGHBOURS)]
    try:
        yield processes
    finally:
        for process in processes:
            process.kill()
            process.wait()
