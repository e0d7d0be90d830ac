# SPDX-License-Identifier: Apache-2.0
"""Topics that end with the next release: their subscribers are named in the log, with the topic to take instead."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rclpy.node import Node
    from rclpy.publisher import Publisher

PLAYER = "toftwin_player"
"""The node of `toftwin replay`, which records these topics as long as there are any, so that runs can be compared with older ones."""
UNKNOWN = "_NODE_NAME_UNKNOWN_"
"""Name of a peer whose announcement has not come yet."""


class Endings:
    """The ending topics of one node: each says so once, to its first subscriber that somebody wrote."""

    def __init__(self, node: Node) -> None:
        """Nothing was logged yet."""
        self._node = node
        self._logged: set[str] = set()
        self._looked: dict[str, int] = {}

    def tell(self, publisher: Publisher, typed: str) -> None:
        """Log that the topic `typed` takes the place of this one, if a subscriber came that was not looked at yet."""
        old, count = publisher.topic_name, publisher.get_subscription_count()
        if old in self._logged or self._looked.get(old) == count:
            return
        names = {p.node_name: f"{p.node_namespace.rstrip('/')}/{p.node_name}" for p in self._node.get_subscriptions_info_by_topic(old)}
        if UNKNOWN in names:
            return
        self._looked[old] = count
        if heard := sorted(name for node, name in names.items() if node != PLAYER):
            self._logged.add(old)
            self._node.get_logger().warning(
                f"{old} ends with the next release: let {', '.join(heard)} hear {typed}, which has typed fields"
            )
