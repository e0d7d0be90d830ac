# SPDX-License-Identifier: Apache-2.0
"""What counts as an answer to a frame, in whatever order the nodes' answers arrive."""

from __future__ import annotations

import time
from itertools import permutations
from typing import TYPE_CHECKING

import pytest

pytest.importorskip("rclpy", reason="no ROS 2 here")
if TYPE_CHECKING:
    from collections.abc import Iterator

    from tof_ros.player import Player

pytestmark = pytest.mark.dds


@pytest.fixture
def player(ros_domain: int) -> Iterator[Player]:
    from tof_ros.environment import ros_context
    from tof_ros.player import Player, PlayOptions

    with ros_context(domain=ros_domain) as context:
        node = Player(context, ["/depth"], ["preproc/done", "label/done"], PlayOptions())
        yield node
        node.destroy_node()


def answer(player: Player, topic: str, stamp: int, fate: str = "kept") -> None:
    from tof_ros.messages import time_reference

    player._answered(f"/{topic}/done", time_reference(stamp, stamp, fate))


@pytest.mark.parametrize("order", list(permutations(["preproc", "label"])))
def test_a_kept_frame_is_answered_by_every_node_in_any_order(player: Player, order: tuple[str, str]) -> None:
    player._open_frame(100)
    answer(player, order[0], 100)
    assert 100 in player._open
    answer(player, order[1], 100)
    assert not player._open
    assert player.report.fates == {"kept": 1}


def test_a_skipped_frame_is_answered_by_the_first_node_alone(player: Player) -> None:
    player._open_frame(100)
    answer(player, "preproc", 100, "no transform")
    assert not player._open
    assert player.report.fates == {"no transform": 1}


def test_an_answer_to_a_frame_that_was_never_sent_changes_nothing(player: Player) -> None:
    player._open_frame(100)
    answer(player, "label", 99)
    assert list(player._open) == [100]


def test_in_real_time_a_lost_frame_is_soon_given_up(ros_domain: int, monkeypatch: pytest.MonkeyPatch) -> None:
    from tof_ros import player as module
    from tof_ros.environment import ros_context

    monkeypatch.setattr(module, "LOSS_S", 0.2)
    with ros_context(domain=ros_domain) as context:
        player = module.Player(context, ["/depth"], ["preproc/done"], module.PlayOptions(realtime=True, give_up_s=5.0))
        player._open_frame(100)
        player._open_frame(200)
        answer(player, "preproc", 100)
        began = time.monotonic()
        player.finish([])
        assert (player.report.lost, time.monotonic() - began < 2.0) == (1, True)
        player.destroy_node()


def test_what_nobody_publishes_is_waited_for_as_long_as_the_graph_lives(player: Player) -> None:
    from sensor_msgs.msg import TimeReference

    from tof_ros import qos
    from tof_ros.player import ReplayError

    for room in ("preproc", "label"):
        player.create_publisher(TimeReference, f"{room}/done", qos.OUTPUT)
    with pytest.raises(ReplayError, match="nobody publishes /label/part after 1 s"):
        player.wait_for_graph({}, lambda: True, lambda: ["/label/part"], timeout_s=1.0)
    with pytest.raises(ReplayError, match="the graph stopped while it started"):
        player.wait_for_graph({}, lambda: False, lambda: ["/label/part"])
    player.wait_for_graph({}, lambda: True)
