# SPDX-License-Identifier: Apache-2.0
"""Runs one node's callbacks in one thread: one wait, then everything that is ready."""

from __future__ import annotations

from itertools import chain
from typing import TYPE_CHECKING, Any

from rclpy.executors import ExternalShutdownException, ShutdownException, SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation as rclpy_c
from rclpy.utilities import timeout_sec_to_nsec

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from rclpy.node import Node

KINDS = ("subscription", "guard_condition", "timer", "client", "service")
"""What a node waits for, as a wait set calls it."""


class DirectExecutor(SingleThreadedExecutor):
    """Executor of callbacks that are plain functions.

    rclpy's own makes a task of each callback and wakes itself twice for it, and each waking builds a wait set of all that
    the node has, in Python. This one builds one, runs all that is ready, and is not woken by its own work.
    """

    def _spin_once_impl(self, timeout_sec: Any = None, wait_condition: Callable[[], bool] = lambda: False) -> None:
        """One turn; other threads may make and destroy entities meanwhile, or shut the executor down."""
        del wait_condition
        self._run_tasks()
        guards = [g for g in (self._guard, self._sigint_gc) if g is not None]
        if self._is_shutdown or len(guards) < 2:
            return
        for take, entity in self._wait(self.get_nodes(), guards, timeout_sec_to_nsec(timeout_sec)):
            if self._is_shutdown:
                return
            if (call := take(entity)) is not None:
                _finish(call())

    def _take_guard_condition(self, gc: Any) -> Any:
        """As of the other kinds: one that another callback of this turn destroyed is called no more."""
        return super()._take_guard_condition(gc) if _alive(gc) else None

    def _take_timer(self, tmr: Any) -> Any:
        """A timer that another callback of this turn cancelled is called no more."""
        return super()._take_timer(tmr) if _alive(tmr) and tmr.handle.is_timer_ready() else None

    def _run_tasks(self) -> None:
        """What a future has to tell once it is done."""
        with self._tasks_lock:
            tasks = list(self._tasks)
            self._tasks.clear()
        for task, _, _ in tasks:
            task()

    def _wait(self, nodes: list[Node], guards: list[Any], timeout_ns: int) -> list[tuple[Callable[[Any], Any], Any]]:
        """Entities that are ready, each behind the method that takes from it."""
        found = (
            chain.from_iterable(n.subscriptions for n in nodes),
            chain(guards, *(n.guards for n in nodes)),
            chain.from_iterable(n.timers for n in nodes),
            chain.from_iterable(n.clients for n in nodes),
            chain.from_iterable(n.services for n in nodes),
        )
        held: list[Any] = []
        try:
            entities = [[e for e in kind if _hold(e.handle, held)] for kind in found]
            waitables = [w for n in nodes for w in n.waitables if _hold(w, held)]
            _hold(self._context.handle, held)
            if self._is_shutdown:  # looked at once all is held: before, the guard that would end the wait may be gone
                raise ShutdownException
            wait_set = _wait_set(entities, waitables, self._context.handle)
            wait_set.wait(timeout_ns)
            if self._is_shutdown:
                raise ShutdownException
            if not self._context.ok():
                raise ExternalShutdownException
            return self._ready(wait_set, entities, waitables, guards)
        finally:
            for handle in held:
                handle.__exit__(None, None, None)

    def _ready(self, wait_set: Any, entities: list[list[Any]], waitables: list[Any], own: list[Any]) -> list[Any]:
        takers = (self._take_subscription, self._take_guard_condition, self._take_timer, self._take_client, self._take_service)
        ready: list[Any] = [(self._take_waitable, w) for w in waitables if w.is_ready(wait_set)]
        for kind, take, some in zip(KINDS, takers, entities, strict=True):
            pointers = wait_set.get_ready_entities(kind)
            ready += [(take, e) for e in some if e.handle.pointer in pointers and e not in own] if pointers else []
        return ready


def _alive(entity: Any) -> bool:
    try:
        with entity.handle:
            return True
    except rclpy_c.InvalidHandle:
        return False


def _hold(handle: Any, held: list[Any]) -> bool:
    """Keep what is not destroyed yet from being so while it is waited for."""
    try:
        handle.__enter__()
    except rclpy_c.InvalidHandle:
        return False
    held.append(handle)
    return True


def _wait_set(entities: list[list[Any]], waitables: Iterable[Any], context: Any) -> Any:
    subscriptions, guards, timers, clients, services = entities
    more = [w.get_num_entities() for w in waitables]
    wait_set = rclpy_c.WaitSet(
        len(subscriptions) + sum(m.num_subscriptions for m in more),
        len(guards) + sum(m.num_guard_conditions for m in more),
        len(timers) + sum(m.num_timers for m in more),
        len(clients) + sum(m.num_clients for m in more),
        len(services) + sum(m.num_services for m in more),
        sum(m.num_events for m in more),
        context,
    )
    wait_set.clear_entities()
    adders = (wait_set.add_subscription, wait_set.add_guard_condition, wait_set.add_timer, wait_set.add_client, wait_set.add_service)
    for add, some in zip(adders, entities, strict=True):
        for entity in some:
            add(entity.handle)
    for waitable in waitables:
        waitable.add_to_wait_set(wait_set)
    return wait_set


def _finish(coroutine: Any) -> None:
    """Run a coroutine that waits for nothing."""
    try:
        coroutine.send(None)
    except StopIteration:
        return
    coroutine.close()
    raise RuntimeError("a callback that waits needs another executor")
