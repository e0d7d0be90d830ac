# SPDX-License-Identifier: Apache-2.0
"""A topic that ends names its successor to the subscribers that somebody wrote, once."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import pytest

pytest.importorskip("rclpy", reason="no ROS 2 here")
from tof_ros.ending import PLAYER, UNKNOWN, Endings


class Graph:
    """A node whose topic is heard by nodes of these names, with its log."""

    def __init__(self) -> None:
        self.names: list[str] = []
        self.log: list[str] = []
        self.publisher: Any = SimpleNamespace(topic_name="/preproc/dwell", get_subscription_count=lambda: len(self.names))

    def get_subscriptions_info_by_topic(self, _: str) -> list[Any]:
        return [SimpleNamespace(node_name=name, node_namespace="/") for name in self.names]

    def get_logger(self) -> Any:
        return SimpleNamespace(warning=self.log.append)


def told(*hearers: list[str]) -> list[str]:
    graph = Graph()
    endings = Endings(cast("Any", graph))
    for names in hearers:
        graph.names = names
        endings.tell(graph.publisher, "/preproc/dwell_info")
    return graph.log


def test_the_player_of_a_replay_is_told_nothing() -> None:
    assert told([PLAYER], [PLAYER]) == []


def test_a_subscriber_is_named_once_also_beside_a_player_and_once_its_name_is_known() -> None:
    line = "/preproc/dwell ends with the next release: let /board hear /preproc/dwell_info, which has typed fields"
    assert told([PLAYER], [PLAYER, UNKNOWN], [PLAYER, "board"], ["board", "other"]) == [line]
