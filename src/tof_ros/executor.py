# SPDX-License-Identifier: Apache-2.0
"""Runs one node's callbacks in one thread: one wait, then everything that is ready."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Coroutine
from functools import partial
from typing import TYPE_CHECKING, Any

from rclpy.executors import Executor, ExternalShutdownException, TimeoutObject
from rclpy.guard_condition import GuardCondition
from rclpy.impl.implementation_singleton import rclpy_implementation as rclpy_c
from rclpy.signals import SignalHandlerGuardCondition
from rclpy.task import Future
from rclpy.utilities import get_default_context, timeout_sec_to_nsec

from tof_ros.wait_set import Waiting, alive
from tof_ros.work import Work, called

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.context import Context
    from rclpy.node import Node

POLL_NS = 10_000_000
"""How long a turn waits at most while a coroutine waits for a future that cannot wake the executor (rclpy up to 7.1.8)."""
SELDOM_S = 0.1
"""Period in which a busy node looks for service calls and for events of DDS (incompatible QoS): three quarters of what a node has to wait for are such,
and each wait names all of it. An idle node waits for all."""

LONGEST_S = 0.05
"""How long a turn after a rest goes on taking messages at most, one more of each topic: timers and services have their turn, too."""


class DirectExecutor(Executor):
    """A single-threaded executor with a wait set per turn, not three per callback.

    rclpy's own makes a task of each callback and wakes itself twice for it, and each waking builds a wait set of all that
    the node has, in Python. This one builds one, runs all that is ready, and is not woken by its own work. A callback that is a
    coroutine and waits holds its callback group until it ends, as with rclpy's.

    Of rclpy's `Executor` it uses what is public and the five `_take_*` methods, which take one message, request, answer, event or
    timer call; tasks, guards and the state of shutdown are its own. `tof_ros.trial` tries it on the rclpy that is installed.

    `rest_s` is a pause before a turn takes what the wait has found: it takes all messages that came meanwhile, too, one of each topic after
    the other.
    """

    rest_s = 0.0

    def __init__(self, *, context: Context | None = None) -> None:
        """No node yet."""
        context = get_default_context() if context is None else context
        self._alarm = GuardCondition(None, None, context=context)
        self._interrupt = SignalHandlerGuardCondition(context)
        self._ended = False
        self._seldom_from = float("-inf")
        self._begun: deque[Work] = deque()
        self._suspended: list[Work] = []
        super().__init__(context=context)
        self._takers: dict[str, Callable[[Any], Any]] = {
            "subscription": self._take_subscription,
            "guard_condition": _take_guard,
            "timer": self._take_due_timer,
            "client": self._take_client,
            "service": self._take_service,
            "waitable": self._take_waitable,
        }

    def wake(self) -> None:
        """End the wait: entities came or went, or there is a task."""
        try:
            self._alarm.trigger()
        except rclpy_c.InvalidHandle:
            return  # shut down

    def add_node(self, node: Node) -> bool:
        """Run a node's callbacks too; false where it was there."""
        added = super().add_node(node)
        self.wake()
        return bool(added)

    def remove_node(self, node: Node) -> None:
        """Run a node's callbacks no more."""
        super().remove_node(node)
        self.wake()

    def create_task(self, callback: Callable[..., Any] | Coroutine[Any, None, Any], *args: Any, **kwargs: Any) -> Future:
        """Run a function or a coroutine in the next turn; any thread may ask."""
        future = Future(executor=self)
        coroutine = callback if isinstance(callback, Coroutine) else called(callback, *args, **kwargs)
        self._begun.append(Work(coroutine, future=future))
        self.wake()
        return future

    def shutdown(self, timeout_sec: float | None = None) -> bool:
        """End the wait and every later turn."""
        if not self._ended:
            self._ended = True
            self.wake()
            self._alarm.destroy()
            self._interrupt.destroy()
        return bool(super().shutdown(timeout_sec))

    def spin(self) -> None:
        """Turn until shutdown."""
        while self.context.ok() and not self._ended:
            self._turn(-1, self.rest_s)

    def spin_once(self, timeout_sec: float | None = None) -> None:
        """One turn: wait, then run everything that is ready."""
        self._turn(timeout_sec_to_nsec(timeout_sec))

    def spin_once_until_future_complete(self, future: Future, timeout_sec: float | TimeoutObject | None = None) -> None:
        """One turn, which the future ends too."""
        future.add_done_callback(lambda _: self.wake())
        self.spin_once(timeout_sec.timeout if isinstance(timeout_sec, TimeoutObject) else timeout_sec)

    def spin_until_future_complete(self, future: Future, timeout_sec: float | None = None) -> None:
        """Turn until a future is done, the time is over, or shutdown."""
        future.add_done_callback(lambda _: self.wake())
        end = float("inf") if timeout_sec is None or timeout_sec < 0 else time.monotonic() + timeout_sec
        while self.context.ok() and not (self._ended or future.done() or future.cancelled()):
            left = end - time.monotonic()
            if left <= 0:
                return
            self.spin_once(None if left == float("inf") else left)

    def _turn(self, timeout_ns: int, rest_s: float = 0.0) -> None:
        """One turn; other threads may make and destroy entities meanwhile, or shut the executor down."""
        self._go_on()
        ready = self._ready(timeout_ns)
        if rest_s and ready:
            time.sleep(rest_s)
            others = [(kind, entity) for kind, entity in ready if kind != "subscription"]
            ready = [("subscription", topic) for node in self.get_nodes() for topic in node.subscriptions] + others
        ends = time.monotonic() + LONGEST_S if self.rest_s else float("-inf")
        while ready := [(kind, entity) for kind, entity in ready if self._take(kind, entity)]:
            if time.monotonic() > ends:
                return

    def _take(self, kind: str, entity: Any) -> bool:
        """Run the callback of an entity that is ready; True where it was a message: another may be queued."""
        if self._ended:
            return False
        if self._suspended and not _may_run(entity):  # its group was taken in this very turn
            if kind == "guard_condition":
                entity.trigger()  # the wait took what had triggered it
            return False
        if (call := self._takers[kind](entity)) is None:
            return False
        self._begin(call(), entity)
        return kind == "subscription"

    def _begin(self, coroutine: Any, entity: Any) -> None:
        """Run a callback; most end here."""
        try:
            awaited = coroutine.send(None)
        except StopIteration:
            return
        entity.callback_group.beginning_execution(entity)
        self._suspend(Work(coroutine, awaited=awaited, entity=entity))

    def _suspend(self, work: Work) -> None:
        self._suspended.append(work)
        if work.awaited is not None:
            work.awaited.add_done_callback(lambda _: self.wake())

    def _go_on(self) -> None:
        """Tasks that were asked for (a future's done callbacks are such), and coroutines whose wait is over."""
        going = [self._begun.popleft() for _ in range(len(self._begun))]
        going += [work for work in self._suspended if work.can_go_on]
        for work in going:
            waited = work in self._suspended
            if waited:
                self._suspended.remove(work)
            ended = True
            try:
                ended = work.step()
            finally:
                if ended and work.entity is not None:
                    work.entity.callback_group.ending_execution(work.entity)
            if not ended:
                self._suspend(work)

    def _ready(self, timeout_ns: int) -> list[tuple[str, Any]]:
        """Wait; what is ready, with its kind."""
        if any(work.awaited is None for work in self._suspended):
            timeout_ns = POLL_NS if timeout_ns < 0 else min(timeout_ns, POLL_NS)
        now = time.monotonic()
        seldom = timeout_ns >= 0 or now >= self._seldom_from
        if not seldom:
            timeout_ns = round((self._seldom_from - now) * 1e9)
        may_run = _may_run if self._suspended else None
        waiting = Waiting(self.get_nodes(), [self._alarm, self._interrupt], self.context, may_run, seldom=seldom)
        try:
            if self._ended:  # looked at once all is held: before, the guard that would end the wait may be gone
                return []
            ready = waiting.wait(timeout_ns)
            if seldom:
                self._seldom_from = time.monotonic() + SELDOM_S
            if not self.context.ok() and not self._ended:
                raise ExternalShutdownException
            return ready
        finally:
            waiting.let_go()

    def _take_due_timer(self, timer: Any) -> Any:
        """A timer that another callback of this turn cancelled is called no more."""
        return self._take_timer(timer) if alive(timer) and timer.handle.is_timer_ready() else None


def _may_run(entity: Any) -> bool:
    """Whether no suspended callback of its group stands in the way."""
    return bool(entity.callback_group.can_execute(entity))


def _take_guard(guard: Any) -> Any:
    """One that another callback of this turn destroyed is called no more."""
    return partial(called, guard.callback) if alive(guard) else None
