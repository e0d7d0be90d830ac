# SPDX-License-Identifier: Apache-2.0
"""What tests need to talk to a running node: wait, call, read its diagnostics and its log."""

from __future__ import annotations

import time
from collections import defaultdict
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Callable


def wait_for(condition: Callable[[], Any], seconds: float = 30.0, what: str = "") -> Any:
    """Until the condition holds; gives what it gave."""
    deadline = time.monotonic() + seconds
    while not (found := condition()):
        assert time.monotonic() < deadline, f"timed out {what}"
        time.sleep(0.01)
    return found


class Observer:
    """A node that calls services and keeps diagnostics and log lines; somebody else spins it."""

    def __init__(self, context: Any, name: str = "observer") -> None:
        import rclpy
        from diagnostic_msgs.msg import DiagnosticArray
        from rcl_interfaces.msg import Log
        from rclpy.qos import DurabilityPolicy, QoSProfile

        from tof_ros import qos

        self.node = rclpy.create_node(name, context=context)
        self.statuses: dict[str, list[Any]] = defaultdict(list)
        self.log: list[str] = []
        self.node.create_subscription(DiagnosticArray, "/diagnostics", self._diagnosed, qos.OUTPUT)
        # As loggers publish: lines of before the two have met are sent again.
        logged = QoSProfile(depth=1000, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.node.create_subscription(Log, "/rosout", lambda m: self.log.append(f"{m.name}: {m.msg}"), logged)

    def _diagnosed(self, message: Any) -> None:
        for status in message.status:
            self.statuses[status.name].append(status)

    def status(self, name: str, fits: Callable[[Any], bool] = lambda _: True, seconds: float = 30.0) -> Any:
        """The newest status of a node once it fits."""
        wait_for(lambda: self.statuses[name] and fits(self.statuses[name][-1]), seconds, f"for a status of {name}")
        return self.statuses[name][-1]

    def values(self, name: str, fits: Callable[[dict[str, str]], bool] = lambda _: True, seconds: float = 30.0) -> dict[str, str]:
        """The values of a node's newest status once they fit."""
        return values(self.status(name, lambda s: fits(values(s)), seconds))

    def call(self, kind: Any, service: str, request: Any = None) -> Any:
        """The answer of a service."""
        client = self.node.create_client(kind, service)
        try:
            assert client.wait_for_service(20.0), service
            answer = client.call(request or kind.Request(), timeout_sec=120.0)
            assert answer is not None, service
            return answer
        finally:
            self.node.destroy_client(client)

    def trigger(self, service: str) -> Any:
        """The answer of a `std_srvs/Trigger`."""
        from std_srvs.srv import Trigger

        return self.call(Trigger, service)

    def act(self, kind: Any, name: str, goal: Any = None, *, cancel_at: str | None = None, seconds: float = 120.0) -> Acted:
        """The end of an action; `cancel_at` cancels it once that step's feedback has come."""
        from rclpy.action import ActionClient

        client = ActionClient(self.node, kind, name)
        steps: list[Any] = []
        try:
            assert client.wait_for_server(20.0), name
            sent = client.send_goal_async(goal or kind.Goal(), feedback_callback=lambda m: steps.append(m.feedback))
            handle = wait_for(lambda: sent.done() and sent.result(), what=f"for {name} to take the goal")
            assert handle.accepted
            if cancel_at is not None:
                wait_for(lambda: any(cancel_at in s.step for s in steps), seconds, f"for the step {cancel_at}")
                handle.cancel_goal_async()
            ended = handle.get_result_async()
            wait_for(ended.done, seconds, f"for the end of {name}")
            return Acted(ended.result().status, ended.result().result, steps)
        finally:
            client.destroy()


class Acted(NamedTuple):
    """Status (action_msgs/GoalStatus), result and feedback of an action."""

    status: int
    result: Any
    steps: list[Any]


def values(status: Any) -> dict[str, str]:
    """Keys and values of a status."""
    return {v.key: v.value for v in status.values}
