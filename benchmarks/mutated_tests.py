# SPDX-License-Identifier: Apache-2.0
"""The tests that judge mutants: collected and run once, then each in a fork of this process, with a fault or without one.

Every fork begins in the same state: test modules imported, nothing kept by caches. So a test says the same whenever it is asked,
and what it executes without a fault tells which mutants it can find.
"""

from __future__ import annotations

import gc
import os
import pickle
import signal
import sys
import tempfile
import threading
import time
from contextlib import contextmanager
from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING, Any

from benchmarks.mutants import REPOSITORY, put_in_place, source_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path
    from types import FrameType

    import pytest

    from benchmarks.mutants import Mutant

PATIENCE, LEAST_S = 4.0, 5.0
"""A mutant whose test takes so many times its processor time without a fault, and seconds more, is found: it does not end."""
HANGS_S = 120.0
"""Seconds of the clock after which a test that waits is ended."""
LONGEST_S = 2.0
"""Processor time of a test beyond which it is not asked: a decision is held by a test of its own, not by a whole pipeline."""


class Asked(Enum):
    """What the tests say of a mutant."""

    FOUND, SURVIVES, NOT_REACHED = range(3)


@dataclass(frozen=True, slots=True)
class Alone:
    """A test run alone without a fault: whether it passes, its processor time in seconds, and lines executed of each watched file."""

    passed: bool
    cpu_s: float
    lines: dict[str, set[int]]


@dataclass(slots=True)
class Asker:
    """The collected tests, and what each of them executes."""

    items: Sequence[pytest.Item]
    out: int
    alone: Sequence[Alone]

    def ask(self, mutant: Mutant) -> Asked:
        """Run the tests that get to the changed statement, the shortest first, until one fails."""
        path, lines = str(source_of(mutant.module)), set(mutant.lines)
        there = [i for i, alone in enumerate(self.alone) if alone.passed and lines & alone.lines[path]]
        for i in sorted(there, key=lambda i: self.alone[i].cpu_s):
            if not _passes(self.items[i], mutant, PATIENCE * self.alone[i].cpu_s + LEAST_S):
                return Asked.FOUND
        return Asked.SURVIVES if there else Asked.NOT_REACHED

    def say(self, line: str) -> None:
        """A line on the terminal's stdout, at once."""
        os.write(self.out, f"{line}\n".encode())


def in_session(tests: Sequence[str], watched: Sequence[Path], ask: Callable[[Asker], None]) -> None:
    """Collect the tests, run them once, then each alone; call `ask` with them. Output of tests is dropped.

    Raises:
        SystemExit: a test fails without any fault.
    """
    import pytest

    problem = ""

    class Plugin:
        def pytest_runtestloop(self, session: pytest.Session) -> bool:
            nonlocal problem
            failing = [item.nodeid for item in _failing(session.items)]
            if failing:
                problem = f"tests fail without any fault: {' '.join(failing)}"
                return True
            _forget()
            gc.collect()
            gc.freeze()  # a fork shares what nobody touches
            asker = Asker(session.items, out, [_alone(item, watched) for item in session.items])
            for item, alone in zip(session.items, asker.alone, strict=True):
                if not alone.passed:
                    asker.say(f"  not asked (skipped, fails alone, or takes more than {LONGEST_S:g} s): {item.nodeid}")
            ask(asker)
            return True

    with tempfile.TemporaryDirectory(prefix="mutate-") as folder, _silent() as out:
        flags = ["-s", "--no-header", "-p", "no:cacheprovider", "-p", "no:xdist", "--timeout=0", "-W", "ignore", f"--basetemp={folder}/t"]
        code = pytest.main([*flags, *tests], plugins=[Plugin()])
    if problem or code not in (pytest.ExitCode.OK, pytest.ExitCode.NO_TESTS_COLLECTED):
        raise SystemExit(problem or f"tests are not collected: {' '.join(tests)}")


@contextmanager
def _silent() -> Iterator[int]:
    """Nothing on stdout and stderr but what is written to the descriptor that this gives."""
    sys.stdout.flush()
    kept = [os.dup(1), os.dup(2)]
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    os.dup2(nowhere, 2)
    try:
        yield kept[0]
    finally:
        sys.stdout.flush()
        os.dup2(kept[0], 1)
        os.dup2(kept[1], 2)
        for descriptor in (nowhere, *kept):
            os.close(descriptor)


def _failing(items: Sequence[pytest.Item]) -> list[pytest.Item]:
    """Run all tests one after the other, so that whatever they import and compile is there; those that fail."""
    following = [*items[1:], None]
    return [item for item, after in zip(items, following, strict=True) if _run(item, after) is False]


def _run(item: pytest.Item, after: pytest.Item | None = None) -> bool | None:
    """Whether a test passes, with its fixtures; None where it is skipped."""
    from _pytest.runner import runtestprotocol

    reports = runtestprotocol(item, log=False, nextitem=after)
    return False if any(r.failed for r in reports) else None if any(r.skipped for r in reports) else True


def _forget() -> None:
    """Empty all caches of tests and rooms: what they keep was made without a fault, and hides which lines make it."""
    rooms = {path.name for path in (REPOSITORY / "src").iterdir()} | {"tests", "benchmarks"}
    for name, module in list(sys.modules.items()):
        if name.partition(".")[0] in rooms:
            for value in list(vars(module).values()):
                if callable(clear := getattr(value, "cache_clear", None)):
                    clear()


def _forked(limit_s: float, work: Callable[[], bytes]) -> bytes | None:
    """What `work` returns in a fork of this process; None where that ends otherwise, or takes more processor time than `limit_s`."""
    read, write = os.pipe()
    child = os.fork()
    if child == 0:
        os.setsid()
        for late in (signal.SIGALRM, signal.SIGPROF):
            signal.signal(late, signal.SIG_DFL)
        signal.setitimer(signal.ITIMER_PROF, limit_s)
        signal.alarm(int(HANGS_S))
        done = False
        try:
            with os.fdopen(write, "wb") as answer:
                answer.write(work())
            done = True
        finally:
            os._exit(0 if done else 1)
    os.close(write)
    with os.fdopen(read, "rb") as answer:
        content = answer.read()
    _, status = os.waitpid(child, 0)
    return content if status == 0 else None


def _passes(item: pytest.Item, mutant: Mutant, limit_s: float) -> bool:
    def work() -> bytes:
        put_in_place(mutant)
        return b"1" if _run(item) else b"0"

    return _forked(limit_s, work) == b"1"


def _alone(item: pytest.Item, watched: Sequence[Path]) -> Alone:
    """Run a test in a fork without a fault, and see which lines of the watched files it executes."""

    def work() -> bytes:
        lines, begin = _trace(watched), time.process_time()
        passed = bool(_run(item))
        sys.settrace(None)
        return pickle.dumps(Alone(passed, time.process_time() - begin, lines))

    answer = _forked(LONGEST_S, work)
    return pickle.loads(answer) if answer else Alone(passed=False, cpu_s=LONGEST_S, lines={})  # noqa: S301 (written above)


def _trace(watched: Sequence[Path]) -> dict[str, set[int]]:
    """Collect from now on, in all threads, the lines that are executed of each file."""
    lines: dict[str, set[int]] = {str(path): set() for path in watched}

    def enter(frame: FrameType, _event: str, _arg: Any) -> Any:
        return inside if frame.f_code.co_filename in lines else None

    def inside(frame: FrameType, _event: str, _arg: Any) -> Any:
        lines[frame.f_code.co_filename].add(frame.f_lineno)
        return inside

    threading.settrace(enter)
    sys.settrace(enter)
    return lines
