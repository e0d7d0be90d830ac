# SPDX-License-Identifier: Apache-2.0
"""A job at a time in a thread of its own, for at most a share of a core."""

from __future__ import annotations

import time
from threading import Event, Thread

import pytest

from tof_sim_label.spare import SpareTime


def busy(seconds: float) -> None:
    """Use so much processor."""
    end = time.thread_time() + seconds
    while time.thread_time() < end:
        pass


def test_while_a_job_is_in_progress_no_other_is_taken() -> None:
    spare, begun, go_on = SpareTime(1.0), Event(), Event()

    def job() -> None:
        begun.set()
        go_on.wait(10.0)

    assert spare.take(job)
    assert begun.wait(10.0)
    assert not spare.take(lambda: None)
    go_on.set()
    spare.finish()
    assert spare.take(lambda: None)
    spare.close()


def test_the_next_job_waits_until_the_share_allows_it() -> None:
    spare, began = SpareTime(0.1), time.monotonic()
    assert spare.take(lambda: busy(0.05))
    spare.finish()
    while not spare.take(lambda: None):
        time.sleep(0.01)
    assert time.monotonic() - began >= 0.5
    spare.close()


def test_what_another_node_of_the_process_uses_meanwhile_does_not_count() -> None:
    spare, node = SpareTime(0.01), Thread(target=busy, args=(0.2,))

    def job() -> None:
        node.start()
        node.join()

    began = time.monotonic()
    assert spare.take(job)
    spare.finish()
    while not spare.take(lambda: None):
        time.sleep(0.01)
    assert time.monotonic() - began < 10.0  # 0.2 s at a share of 0.01 would be 20
    spare.close()


def test_what_a_job_raises_is_raised_by_the_next_call() -> None:
    spare = SpareTime(1.0)

    def job() -> None:
        raise ValueError("no scene")

    assert spare.take(job)
    with pytest.raises(ValueError, match="no scene"):
        spare.finish()
    spare.finish()
    spare.close()
