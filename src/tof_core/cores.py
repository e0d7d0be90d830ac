# SPDX-License-Identifier: Apache-2.0
"""The cores of this process: work in threads, or linear algebra limited to one thread."""

from __future__ import annotations

import os
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    S = TypeVar("S")
    T = TypeVar("T")

CORES = len(os.sched_getaffinity(0))
"""Cores that this process may use."""

ONE_THREAD = {
    **dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1"),
    "OMP_WAIT_POLICY": "PASSIVE",
}
"""Environment that limits linear algebra and kernels to one thread; where OpenMP gets more (PyTorch), waiting threads sleep.

On small matrices more threads gain nothing, and while they wait for each other they take cores from other processes.
"""
CLOCK_TICK = 0.01
"""Seconds of the unit in /proc/stat."""


def one_thread() -> None:
    """Set the variables of `ONE_THREAD` that are not set; call it before NumPy is imported, which reads them."""
    for name, value in ONE_THREAD.items():
        os.environ.setdefault(name, value)


LOOK_S = 0.5
"""Seconds between two measurements of what other processes use."""


class FreeCores:
    """Cores of this process that other processes leave free.

    Threads that wait for each other are as slow as the one whose core, or whose interpreter lock, another process holds: beside
    busy processes one thread is faster than two.
    """

    def __init__(self) -> None:
        """Take the first measurement."""
        self._seen, self._count = _used(), CORES

    def count(self) -> int:
        """Cores that other processes left free between the last two measurements; at least 1."""
        if time.monotonic() - self._seen[0] >= LOOK_S:
            before, self._seen = self._seen, _used()
            seconds, busy, own = (now - then for now, then in zip(self._seen, before, strict=True))
            self._count = max(1, min(CORES, round(CORES - (busy - own) / seconds)))
        return self._count


def _used() -> tuple[float, float, float]:
    """Seconds: clock, processor time of all processes on this process's cores (0 without /proc/stat), processor time of this process."""
    try:
        lines = Path("/proc/stat").read_text(encoding="ascii").splitlines()
    except OSError:  # not Linux: all cores count as free
        return time.monotonic(), 0.0, 0.0
    names = {f"cpu{core}" for core in os.sched_getaffinity(0)}
    busy = 0
    for name, *ticks in (line.split() for line in lines if line.startswith("cpu")):
        if name in names:
            user, nice, system, _idle, _wait, irq, soft, steal, *_ = map(int, ticks)
            busy += user + nice + system + irq + soft + steal
    return time.monotonic(), busy * CLOCK_TICK, time.process_time()


FREE = FreeCores()
"""Measurement of this process."""


class _Helped(threading.local):
    """Per thread: processor time in seconds that other threads have used for it."""

    seconds = 0.0


_HELPED = _Helped()


def thread_seconds() -> float:
    """Processor time in seconds of this thread and of the threads that `in_threads` started for it; other work of the process does not count."""
    return time.thread_time() + _HELPED.seconds


def in_threads(work: Callable[..., T], *each: Iterable[object]) -> list[T]:
    """Apply `work` to each item, in as many threads as cores are free; results in order, like `map`. An exception of `work` is raised here.

    NumPy, the ray casters and the compiled kernels release the interpreter lock.
    """
    threads = FREE.count()
    if threads == 1:
        return list(map(work, *each))
    spent: list[float] = []

    def timed(*items: object) -> T:
        began = thread_seconds()
        try:
            return work(*items)
        finally:
            spent.append(thread_seconds() - began)

    try:
        with ThreadPoolExecutor(threads) as pool:  # made anew: one kept at module level would not survive a fork
            return list(pool.map(timed, *each))
    finally:
        _HELPED.seconds += sum(spent)


def in_blocks(work: Callable[[S], T], each: Sequence[S], block: int = 8) -> Iterator[T]:
    """The results of `in_threads` one after another, computed in blocks: for results so large that only a block fits into memory."""
    for start in range(0, len(each), block):
        yield from in_threads(work, each[start : start + block])
