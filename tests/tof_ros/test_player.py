# SPDX-License-Identifier: Apache-2.0
"""What counts as an answer to a frame, in whatever order the nodes' answers arrive."""

from __future__ import annotations

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
