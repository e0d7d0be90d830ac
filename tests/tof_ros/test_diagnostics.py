# SPDX-License-Identifier: Apache-2.0
"""What a node's diagnostics write into its log: a warning once, also one that comes and goes; a silence each time."""

from __future__ import annotations

from typing import Any

import pytest

pytest.importorskip("rclpy", reason="no ROS 2 here")
from builtin_interfaces.msg import Time

from tof_ros import diagnostics
from tof_ros.diagnostics import Diagnostics, Tally


class Node:
    """A node of which only the log and the messages matter."""

    def __init__(self) -> None:
        self.log: list[str] = []
        self.sent: list[Any] = []

    def __getattr__(self, name: str) -> Any:
        return lambda *_, **__: self

    def warning(self, line: str) -> None:
        self.log.append(line)

    def publish(self, message: Any) -> None:
        self.sent.append(message.status[0])

    def to_msg(self) -> Time:
        return Time()

    def get_fully_qualified_name(self) -> str:
        return "/spot/preproc"


class Said:
    """What the node complains of, and what it wrote."""

    def __init__(self) -> None:
        self.node, self.tally = Node(), Tally()
        self.warnings: list[str] = []
        self.silence = ""
        self.diagnostics = Diagnostics(self.node, self.tally, dict, lambda: self.warnings, str, lambda: self.silence)

    def publish(self, *warnings: str, silence: str = "") -> list[str]:
        self.warnings, self.silence, self.node.log = list(warnings), silence, []
        self.diagnostics.publish()
        return self.node.log


def test_a_warning_is_logged_once_while_it_lasts_or_comes_and_goes(monkeypatch: pytest.MonkeyPatch) -> None:
    said = Said()
    assert said.publish("views are refused: 1") == ["views are refused: 1"]
    assert said.publish("views are refused: 2", "another: 1") == ["another: 1"]
    assert said.publish() == []
    assert said.publish("views are refused: 3") == []
    assert said.node.sent[-1].message == "views are refused: 3"
    monkeypatch.setattr(diagnostics, "AGAIN_S", -1.0)
    assert said.publish("views are refused: 4") == ["views are refused: 4"]


def test_a_silence_is_logged_each_time_it_begins() -> None:
    said = Said()
    assert said.publish(silence="no frame") == ["no frame"]
    assert said.publish(silence="no frame") == []
    assert said.publish() == []
    assert said.publish(silence="no frame") == ["no frame"]


def test_frames_that_never_reached_the_node_are_seen_and_skipped() -> None:
    said = Said()
    said.tally.arrived()
    said.tally.done(0.0)
    said.tally.lose("overrun", 3)
    assert (said.tally.seen, said.tally.kept, said.tally.skipped.total()) == (4, 1, 3)
    assert said.publish() == ["frames skipped: 3 in the last second (in all: overrun 3)"]
