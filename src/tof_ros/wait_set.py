# SPDX-License-Identifier: Apache-2.0
"""One wait for everything that some nodes have, and what of it is ready."""

from __future__ import annotations

from itertools import chain
from typing import TYPE_CHECKING, Any

from rclpy.event_handler import EventHandler
from rclpy.impl.implementation_singleton import rclpy_implementation as rclpy_c

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from rclpy.context import Context
    from rclpy.node import Node

KINDS = ("subscription", "guard_condition", "timer", "client", "service")
"""What a node waits for, as a wait set calls it; waitables (events, actions) are asked themselves."""


class Waiting:
    """The entities of some nodes, kept from being destroyed between the wait and the look at what is ready."""

    def __init__(
        self, nodes: list[Node], guards: list[Any], context: Context, may_run: Callable[[Any], bool] | None, *, seldom: bool = True
    ) -> None:
        """`guards` are the executor's own; what may not run is not waited for (None: all may), nor are services and events of DDS without `seldom`."""
        self._held: list[Any] = []
        self._context = context
        found = (
            chain.from_iterable(n.subscriptions for n in nodes),
            chain.from_iterable(n.guards for n in nodes),
            chain.from_iterable(n.timers for n in nodes),
            chain.from_iterable(n.clients for n in nodes),
            chain.from_iterable(n.services for n in nodes if seldom),
        )
        self._guards = [g for g in guards if self._hold(g.handle)]
        hold = self._hold
        self._entities = [[e for e in kind if (may_run is None or may_run(e)) and hold(e.handle)] for kind in found]
        asked = (w for n in nodes for w in n.waitables if seldom or not isinstance(w, EventHandler))
        self._waitables = [w for w in asked if (may_run is None or may_run(w)) and hold(w)]
        self._hold(context.handle)

    def _hold(self, handle: Any) -> bool:
        try:
            handle.__enter__()
        except rclpy_c.InvalidHandle:
            return False
        self._held.append(handle)
        return True

    def let_go(self) -> None:
        """What was destroyed meanwhile may go."""
        for handle in self._held:
            handle.__exit__(None, None, None)
        self._held.clear()

    def wait(self, timeout_ns: int) -> list[tuple[str, Any]]:
        """Wait, forever where the time is negative; what is ready, with its kind."""
        wait_set = self._wait_set()
        wait_set.wait(timeout_ns)
        ready: list[tuple[str, Any]] = [("waitable", w) for w in self._waitables if w.is_ready(wait_set)]
        for kind, some in zip(KINDS, self._entities, strict=True):
            if some and (pointers := wait_set.get_ready_entities(kind)):
                ready += [(kind, e) for e in some if e.handle.pointer in pointers]
        return ready

    def _wait_set(self) -> Any:
        subscriptions, guards, timers, clients, services = self._entities
        guards = [*self._guards, *guards]
        more = [w.get_num_entities() for w in self._waitables]
        wait_set = rclpy_c.WaitSet(
            len(subscriptions) + sum(m.num_subscriptions for m in more),
            len(guards) + sum(m.num_guard_conditions for m in more),
            len(timers) + sum(m.num_timers for m in more),
            len(clients) + sum(m.num_clients for m in more),
            len(services) + sum(m.num_services for m in more),
            sum(m.num_events for m in more),
            self._context.handle,
        )
        wait_set.clear_entities()
        add_all(wait_set.add_subscription, subscriptions)
        add_all(wait_set.add_guard_condition, guards)
        add_all(wait_set.add_timer, timers)
        add_all(wait_set.add_client, clients)
        add_all(wait_set.add_service, services)
        for waitable in self._waitables:
            waitable.add_to_wait_set(wait_set)
        return wait_set


def add_all(add: Callable[[Any], object], entities: Iterable[Any]) -> None:
    """Add each entity's handle to the wait set."""
    for entity in entities:
        add(entity.handle)


def alive(entity: Any) -> bool:
    """Whether an entity is not destroyed yet."""
    try:
        with entity.handle:
            return True
    except rclpy_c.InvalidHandle:
        return False
