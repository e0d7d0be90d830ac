# SPDX-License-Identifier: Apache-2.0
"""Work in threads: results in order, exceptions passed on, as many as cores are free."""

from __future__ import annotations

import subprocess
import sys
import threading
import time

import pytest

from tof_core import cores


@pytest.fixture(params=[1, 4])
def _cores(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cores.FREE, "count", lambda: request.param)


@pytest.mark.usefixtures("_cores")
def test_results_come_in_the_order_of_the_items() -> None:
    def late(n: int, more: int) -> int:
        time.sleep(0.02 * (n == 0))
        return n + more

    assert cores.in_threads(late, range(5), range(10, 15)) == [10, 12, 14, 16, 18]


@pytest.mark.usefixtures("_cores")
def test_an_exception_of_a_thread_is_raised() -> None:
    with pytest.raises(ZeroDivisionError):
        cores.in_threads(lambda n: 1 / n, [1, 0, 2])


@pytest.mark.usefixtures("_cores")
def test_a_block_is_computed_when_the_one_before_it_has_been_taken() -> None:
    begun: list[int] = []

    def work(n: int) -> int:
        begun.append(n)
        return n * n

    results = cores.in_blocks(work, range(7), block=3)
    assert next(results) == 0
    assert sorted(begun) == [0, 1, 2]
    assert list(results) == [1, 4, 9, 16, 25, 36]


def use(seconds: float) -> None:
    """Use so much processor in this thread."""
    end = time.thread_time() + seconds
    while time.thread_time() < end:
        pass


@pytest.mark.usefixtures("_cores")
def test_a_threads_seconds_are_its_own_and_those_of_the_threads_that_it_gave_work_to() -> None:
    before = cores.thread_seconds()
    use(0.02)
    cores.in_threads(lambda _: cores.in_threads(use, [0.02, 0.02]), range(2))
    assert 0.1 <= cores.thread_seconds() - before < 0.15


def test_a_threads_seconds_lack_what_other_threads_do() -> None:
    before, other = cores.thread_seconds(), threading.Thread(target=use, args=(0.1,))
    other.start()
    other.join()
    assert cores.thread_seconds() - before < 0.05


@pytest.mark.parametrize(
    ("busy", "own", "free"),
    [(0.0, 0.0, 4), (10.0, 0.0, 3), (40.0, 10.0, 1), (40.0, 40.0, 4), (22.0, 8.0, 3), (40.0, 0.0, 1)],
)
def test_cores_are_free_that_no_other_process_uses(monkeypatch: pytest.MonkeyPatch, busy: float, own: float, free: int) -> None:
    looks = iter([(0.0, 100.0, 5.0), (10.0, 100.0 + busy, 5.0 + own)])
    monkeypatch.setattr(cores, "CORES", 4)
    monkeypatch.setattr(cores, "_used", lambda: next(looks))
    assert cores.FreeCores().count() == free


def test_between_two_looks_the_last_count_holds(monkeypatch: pytest.MonkeyPatch) -> None:
    looks = iter([(0.0, 0.0, 0.0), (1.0, 4.0, 0.0), (1.0 + 2 * cores.LOOK_S, 4.0, 0.0)])
    clock = iter([1.0, 1.0 + 0.5 * cores.LOOK_S, 1.0 + 2 * cores.LOOK_S])
    monkeypatch.setattr(cores, "CORES", 4)
    monkeypatch.setattr(cores, "_used", lambda: next(looks))
    monkeypatch.setattr(time, "monotonic", lambda: next(clock))
    free = cores.FreeCores()
    assert [free.count() for _ in range(3)] == [1, 1, 4]


def test_a_busy_neighbour_is_seen() -> None:
    neighbour = subprocess.Popen([sys.executable, "-S", "-c", "while True: pass"])
    try:
        before = cores._used()
        time.sleep(0.5)
        after = cores._used()
    finally:
        neighbour.kill()
        neighbour.wait()
    seconds, busy, own = (now - then for now, then in zip(after, before, strict=True))
    assert own < 0.2
    assert busy > 0.05 * seconds
