# SPDX-License-Identifier: Apache-2.0
"""Peers with incompatible QoS: the event of DDS, reported with topic, policy, peer and remedy."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.qos import QoSCompatibility, qos_check_compatible, qos_policy_name_from_kind

if TYPE_CHECKING:
    from rclpy.node import Node


class Mismatches:
    """The incompatible peers of one node's topics.

    A reliable subscription receives nothing from a best-effort publisher, without any other message. Each event is logged once;
    `current` repeats it in the diagnostics as long as such a peer exists.
    """

    def __init__(self, node: Node) -> None:
        """No event yet."""
        self._node = node
        self._events: dict[tuple[str, bool], str] = {}

    def of_subscription(self, topic: str) -> SubscriptionEventCallbacks:
        """The events of a subscription."""
        return SubscriptionEventCallbacks(incompatible_qos=lambda event: self._note(topic, event, heard=True))

    def of_publisher(self, topic: str) -> PublisherEventCallbacks:
        """The events of a publisher."""
        # Each event handler is one more thing to wait for, in every turn of the node: none beside ours.
        return PublisherEventCallbacks(incompatible_qos=lambda event: self._note(topic, event, heard=False), use_default_callbacks=False)

    def _note(self, topic: str, event: Any, *, heard: bool) -> None:
        name = self._node.resolve_topic_name(topic)
        self._events[name, heard] = qos_policy_name_from_kind(event.last_policy_kind).lower()
        self._node.get_logger().warning(self._told(name, heard=heard))

    def _told(self, topic: str, *, heard: bool) -> str:
        policy = self._events[topic, heard]
        peers = ", ".join(self._peers(topic, heard=heard)) or "a peer"
        if heard:
            ours = policy == "reliability" and self._node.has_parameter("live.reliable")
            return (
                f"QoS of {topic}: {peers} offers another {policy} than is asked for here, so nothing of it is heard; "
                f"set qos_overrides.{topic}.subscription.{policy}{' (or live.reliable:=false)' if ours else ''}"
            )
        return (
            f"QoS of {topic}: {peers} asks for another {policy} than is offered here, so it hears nothing; "
            f"set qos_overrides.{topic}.publisher.{policy}, or the other side's"
        )

    def _peers(self, topic: str, *, heard: bool) -> list[str]:
        """Names of the nodes whose profile does not fit ours."""
        offers = self._node.get_publishers_info_by_topic(topic)
        requests = self._node.get_subscriptions_info_by_topic(topic)
        mine = (self._node.get_name(), self._node.get_namespace())
        ours = [i for i in (requests if heard else offers) if (i.node_name, i.node_namespace) == mine]
        out = set()
        for peer in offers if heard else requests:
            pairs = [(peer, i) if heard else (i, peer) for i in ours]
            if any(qos_check_compatible(p.qos_profile, s.qos_profile)[0] == QoSCompatibility.ERROR for p, s in pairs):
                out.add(f"{peer.node_namespace.rstrip('/')}/{peer.node_name}")
        return sorted(out)

    def current(self) -> list[str]:
        """What is wrong now, one line a topic."""
        gone = [key for key in self._events if not self._peers(key[0], heard=key[1])]
        for key in gone:
            del self._events[key]
        return [self._told(topic, heard=heard) for topic, heard in self._events]
