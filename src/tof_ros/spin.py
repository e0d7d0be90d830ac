# SPDX-License-Identifier: Apache-2.0
"""Several nodes in one process, each with an executor and a thread of its own: a slow node delays no other."""

from __future__ import annotations

import threading
from contextlib import contextmanager
from typing import TYPE_CHECKING

from rclpy.executors import ExternalShutdownException, MultiThreadedExecutor, ShutdownException

from tof_ros.executor import DirectExecutor
from tof_ros.trial import CHOICE

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from rclpy.node import Node


class Spinner:
    """One node's thread. An exception that leaves a callback is kept in `error` and stops the node.

    A node may have `helpers`, small nodes with threads of their own: where one dies, the node counts as dead, with the helper's error.
    """

    def __init__(self, node: Node, rest_s: float = 0.0) -> None:
        """Start spinning; `rest_s`, or the node's own, is the pause after each turn (`DirectExecutor.rest_s`)."""
        self.node = node
        self._error: BaseException | None = None
        threads = getattr(node, "threads", 1)
        self._executor = MultiThreadedExecutor(threads, context=node.context) if threads > 1 else CHOICE.executor(node.context)
        self.rest(rest_s or getattr(node, "rest_s", 0.0))
        self._executor.add_node(node)
        self._thread = threading.Thread(target=self._spin, name=node.get_name(), daemon=True)
        self._thread.start()

    def _spin(self) -> None:
        try:
            self._executor.spin()
        except (ExternalShutdownException, ShutdownException):
            pass
        except BaseException as error:  # noqa: BLE001  (handed to whoever waits)
            self._error = error

    def rest(self, seconds: float) -> None:
        """Pause so long after each turn from the next one on; rclpy's own executors know no pause."""
        if isinstance(self._executor, DirectExecutor):
            self._executor.rest_s = seconds

    @property
    def _helpers(self) -> tuple[Spinner, ...]:
        return tuple(getattr(self.node, "helpers", ()))

    @property
    def alive(self) -> bool:
        """Whether the node and all its helpers still spin."""
        return self._thread.is_alive() and all(helper.alive for helper in self._helpers)

    @property
    def error(self) -> BaseException | None:
        """What ended the node or a helper of it."""
        return self._error or next((helper.error for helper in self._helpers if helper.error), None)

    def stop(self) -> None:
        """Stop spinning and destroy the node."""
        self._executor.shutdown(timeout_sec=5.0)
        self._thread.join(timeout=5.0)
        self.node.destroy_node()


@contextmanager
def spinning(nodes: Sequence[Node]) -> Iterator[list[Spinner]]:
    """Spin nodes while the block runs."""
    spinners = [Spinner(node) for node in nodes]
    try:
        yield spinners
    finally:
        for spinner in reversed(spinners):
            spinner.stop()
