# SPDX-License-Identifier: Apache-2.0
"""The progress of an action: each step once as it begins, and again while it lasts."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

pytest.importorskip("rclpy", reason="no ROS 2 here")
from tof_ros.actions import BEAT_S, Progress


def test_a_step_that_lasts_is_said_again_with_the_time_since_the_beginning(monkeypatch: pytest.MonkeyPatch) -> None:
    now, sent = [100.0], list[Any]()
    monkeypatch.setattr("tof_ros.actions.time", SimpleNamespace(monotonic=lambda: now[0]))
    goal = SimpleNamespace(is_cancel_requested=False, publish_feedback=sent.append)
    progress = Progress(goal, lambda: SimpleNamespace(step="", seconds=0.0), lambda: "")
    progress.check()
    progress("poses")
    for _ in range(3):
        now[0] += 0.6 * BEAT_S
        progress.check()
    progress("report")
    assert [(m.step, round(m.seconds / BEAT_S, 1)) for m in sent] == [("poses", 0.0), ("poses", 1.2), ("report", 1.8)]


def test_counted_steps_keep_their_count_while_they_last(monkeypatch: pytest.MonkeyPatch) -> None:
    now, sent = [100.0], list[Any]()
    monkeypatch.setattr("tof_ros.actions.time", SimpleNamespace(monotonic=lambda: now[0]))
    goal = SimpleNamespace(is_cancel_requested=False, publish_feedback=sent.append)
    progress = Progress(goal, lambda: SimpleNamespace(step="", done=0, total=0), lambda: "")
    progress.total = 2
    for step in ("one", "two"):
        progress(step)
        now[0] += 1.5 * BEAT_S
        progress.check()
    assert [(m.step, m.done, m.total) for m in sent] == [("one", 0, 2), ("one", 0, 2), ("two", 1, 2), ("two", 1, 2)]
