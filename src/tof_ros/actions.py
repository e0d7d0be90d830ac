# SPDX-License-Identifier: Apache-2.0
"""Long work of a node as a ROS action: steps as feedback, cancelled between two steps, one at a time."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

from rclpy.action import ActionServer, CancelResponse
from rclpy.callback_groups import ReentrantCallbackGroup

from tof_core.errors import RefusedError, ToftwinError
from tof_ros.interfaces import own_action

if TYPE_CHECKING:
    from collections.abc import Callable

    from tof_ros.managed import ManagedNode


def quiet(step: str) -> None:
    """The progress of a service, which reports none."""
    del step


BEAT_S = 2.0
"""A step that lasts says so again after this time: a client sees that the work goes on."""


class Cancelled(Exception):  # noqa: N818  (no error: the client asked for it)
    """The client cancelled the goal."""


class Progress:
    """Called with the name of each step that begins: sends it as feedback, and ends the work where the goal is cancelled.

    `total` is the number of steps, 0 where that is not known before the end.
    """

    def __init__(self, goal: Any, feedback: Callable[[], Any], stopped: Callable[[], str]) -> None:
        """`feedback` makes an empty feedback message; `stopped` gives the reason why the work must end, empty while it need not."""
        self._goal, self._feedback, self._stopped = goal, feedback, stopped
        self._done, self._began = 0, time.monotonic()
        self._sent = self._began
        self.step, self.total = "start", 0

    def __call__(self, step: str) -> None:
        """A step begins.

        Raises:
            Cancelled: by the client.
            RefusedError: the node was deactivated.
        """
        self.check()
        self.step, self._done = step, self._done + 1
        self._send()

    def _send(self) -> None:
        message, self._sent = self._feedback(), time.monotonic()
        message.step = self.step
        if hasattr(message, "seconds"):
            message.seconds = self._sent - self._began
        else:
            message.done, message.total = self._done - 1, self.total
        self._goal.publish_feedback(message)

    def check(self) -> None:
        """End the work where it was cancelled or the node was deactivated; for loops within a step, which also says the step again."""
        if self._goal.is_cancel_requested:
            raise Cancelled
        if why := self._stopped():
            raise RefusedError(why, where=self.step, todo="activate the node and ask again")
        if self._done and time.monotonic() - self._sent > BEAT_S:
            self._send()


def serve(node: ManagedNode[Any], name: str, kind: str, work: Callable[[Any, Progress], Any]) -> None:
    """Offer the action `~/name` of toftwin_msgs, where that is installed.

    A goal is always taken up: one that cannot be worked on (the node is not active, another command runs, `work` refuses) is aborted with
    the reason in the result's `message`; ROS gives a rejected goal no reason.

    Args:
        node: it must be spun with two threads or more: frames go on beside the work.
        name: of the action, below the node's.
        kind: name of the class in toftwin_msgs; its result has `success` and `message`.
        work: called with the goal and its progress; returns the result.
    """
    found = own_action(kind)
    if found is None:
        return

    def execute(goal: Any) -> Any:
        progress = Progress(goal, found.Feedback, lambda: "" if node.active else f"the node is {node.state}")
        try:
            progress.check()
            with node.alone():
                result = work(goal.request, progress)
        except Cancelled:
            goal.canceled()
            return found.Result(success=False, message=f"cancelled: {progress.step}")
        except (ToftwinError, OSError) as error:
            goal.abort()
            return found.Result(success=False, message=str(error))
        if result.success:
            goal.succeed()
        else:
            goal.abort()
        return result

    server = ActionServer(
        node, found, f"~/{name}", execute, callback_group=ReentrantCallbackGroup(), cancel_callback=lambda _: CancelResponse.ACCEPT
    )
    node.at_end.append(server.destroy)
