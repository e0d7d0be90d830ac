# SPDX-License-Identifier: Apache-2.0
"""A ticker wakes its node while something waits, and not otherwise."""

from __future__ import annotations

from typing import Any

import pytest

pytest.importorskip("rclpy", reason="no ROS 2 here")
from tof_ros.ticker import Ticker


class Timer:
    """A timer as rclpy has it, called by hand."""

    def __init__(self) -> None:
        self.runs = True

    def cancel(self) -> None:
        self.runs = False

    def reset(self) -> None:
        self.runs = True

    def is_canceled(self) -> bool:
        return not self.runs


class Node:
    def __init__(self) -> None:
        self.made = Timer()

    def timer(self, seconds: float, action: Any) -> Timer:
        assert seconds > 0
        self.tick = action
        return self.made


def test_it_runs_from_start_until_nothing_waits() -> None:
    node, waiting = Node(), [True, True, False]
    ticker = Ticker(node, lambda: waiting.pop(0))  # type: ignore[arg-type]
    assert not node.made.runs
    ticker.start()
    runs = []
    for _ in range(3):
        runs.append(node.made.runs)
        node.tick()
    assert (runs, node.made.runs) == ([True, True, True], False)
    ticker.start()
    assert node.made.runs


@pytest.mark.dds
def test_a_node_without_frames_is_woken_by_its_diagnostics_alone(ros_domain: int) -> None:
    import time

    from tof_preproc.node import make_node
    from tof_ros.environment import ros_context
    from tof_ros.executor import DirectExecutor

    with ros_context(domain=ros_domain) as context:
        node = make_node(context=context)
        executor = DirectExecutor(context=context)
        executor.add_node(node)
        for _ in range(20):  # what is due at the start
            executor.spin_once(0.05)
        turns, end = 0, time.monotonic() + 3.0
        while time.monotonic() < end:
            executor.spin_once(3.0)
            turns += 1
        executor.shutdown()
        node.destroy_node()
    assert turns <= 8, "one a second by the diagnostics"
