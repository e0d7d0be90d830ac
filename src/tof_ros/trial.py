# SPDX-License-Identifier: Apache-2.0
"""Which single-threaded executor runs the nodes: the graph's own where it works with the rclpy that is installed, else rclpy's."""

from __future__ import annotations

import os
import threading
from dataclasses import dataclass, field
from itertools import count
from typing import TYPE_CHECKING, Any

import rclpy
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.clock import Clock, ClockType
from rclpy.executors import Executor, SingleThreadedExecutor
from rclpy.logging import get_logger
from rclpy.task import Future
from std_msgs.msg import Empty as Nothing
from std_srvs.srv import Empty

from tof_ros.environment import rclpy_version, ros_context
from tof_ros.executor import DirectExecutor

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.context import Context
    from rclpy.node import Node

DEADLINE_S = 5.0
"""A trial takes some 20 ms; on a loaded host it may wait this long for its messages."""
_numbers = count()


class Trial:
    """A hidden node with one of each thing that a node of the graph has, and what of it has run."""

    def __init__(self, context: Context) -> None:
        """Everything is due at once."""
        self.ran: set[str] = set()
        self.all_ran = threading.Event()
        name = f"_toftwin_trial_{os.getpid()}_{next(_numbers)}"
        self.node: Node = rclpy.create_node(
            name, context=context, use_global_arguments=False, enable_rosout=False, start_parameter_services=False
        )
        node, topic = self.node, f"{name}_topic"
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        answered: Future = Future()
        self._due = {
            "guard condition": node.create_guard_condition(self._noted("guard condition")),
            # In a group of its own: a callback that waits holds its group.
            "coroutine": node.create_guard_condition(self._waiting(answered), callback_group=MutuallyExclusiveCallbackGroup()),
        }
        node.create_subscription(Nothing, topic, self._noted("subscription"), 1)
        publisher = node.create_publisher(Nothing, topic, 1)
        node.create_service(Empty, f"{name}_service", lambda _, response: response)
        client = node.create_client(Empty, f"{name}_service")

        def answer(done: Future) -> None:
            self._note("service and future")
            answered.set_result(done.result())

        def ask() -> None:
            self._note("timer")
            if "subscription" not in self.ran:
                publisher.publish(Nothing())
            if client.service_is_ready() and not asked:
                asked.append(client.call_async(Empty.Request()))
                asked[0].add_done_callback(answer)

        asked: list[Future] = []
        node.create_timer(0.005, ask, clock=steady)
        for guard in self._due.values():
            guard.trigger()

    PARTS = frozenset({"guard condition", "timer", "subscription", "service and future", "coroutine"})

    def _note(self, part: str) -> None:
        self.ran.add(part)
        if self.ran >= self.PARTS:
            self.all_ran.set()

    def _noted(self, part: str) -> Callable[..., None]:
        return lambda *_: self._note(part)

    def _waiting(self, answered: Future) -> Callable[[], Any]:
        async def wait() -> None:
            await answered
            self._note("coroutine")

        return wait


def failure(executor: Callable[..., Executor], context: Context) -> str:
    """Run a hidden node by such an executor: empty where all ran, else what did not or what was raised."""
    trial = Trial(context)
    raised: list[BaseException] = []

    def spin(runner: Executor) -> None:
        try:
            runner.spin()
        except BaseException as error:  # noqa: BLE001  (whatever it is, it is the answer)
            raised.append(error)
            trial.all_ran.set()

    try:
        runner = executor(context=context)
        runner.add_node(trial.node)
        thread = threading.Thread(target=spin, args=[runner], name=trial.node.get_name(), daemon=True)
        thread.start()
        trial.all_ran.wait(DEADLINE_S)
        lacking = sorted(trial.PARTS - trial.ran)
        early = list(raised)
        runner.shutdown(timeout_sec=DEADLINE_S)
        thread.join(DEADLINE_S)
    except Exception as error:  # noqa: BLE001  (as above)
        return f"{type(error).__name__}: {error}"
    finally:
        trial.node.destroy_node()
    if early:
        return f"{type(early[0]).__name__}: {early[0]}"
    if thread.is_alive():
        return f"it did not stop within {DEADLINE_S:.0f} s"
    return f"not run within {DEADLINE_S:.0f} s: {', '.join(lacking)}" if lacking else ""


@dataclass
class Choice:
    """The executor of this process, tried once, when the first node is spun."""

    own: Callable[..., Executor] = DirectExecutor
    _why: str | None = None
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def executor(self, context: Context) -> Executor:
        """An executor for one node; where the graph's own does not work, rclpy's, with one warning."""
        with self._lock:
            if self._why is None:
                self._why = failure(self.own, context)
                if self._why:
                    get_logger("toftwin").warning(
                        f"the graph's own executor does not work with rclpy {rclpy_version()} ({self._why}); "
                        "rclpy's SingleThreadedExecutor runs the nodes, at about a third more processor time per message"
                    )
        return SingleThreadedExecutor(context=context) if self._why else self.own(context=context)


CHOICE = Choice()


def try_here() -> dict[str, str]:
    """What fails in each executor, on this host and the rclpy that is installed; empty texts where nothing does."""
    with ros_context() as context:
        return {executor.__name__: failure(executor, context) for executor in (DirectExecutor, SingleThreadedExecutor)}
