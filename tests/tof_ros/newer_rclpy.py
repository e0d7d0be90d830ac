# SPDX-License-Identifier: Apache-2.0
"""The layout that rclpy's executors have from 7.1.9 on, put over the installed one.

What changed there (ros2/rclpy pull requests 1469 and 1560): an executor has no list `_tasks` but `_pending_tasks` and `_ready_tasks`,
a task is put among the ready ones by `_call_task_in_next_spin`, and a future that is awaited yields itself once, not None again and
again. Only what a single-threaded executor of this project could lean on is emulated; rclpy's own executors do not run under it.
"""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Generator

    import pytest


def emulate(patch: pytest.MonkeyPatch) -> None:
    """Give rclpy's `Executor`, `Future` and `Task` the newer layout until the patch is undone."""
    from rclpy.executors import Executor
    from rclpy.task import Future, Task

    older = Executor.__init__

    def begin(self: Any, *, context: Any = None) -> None:
        older(self, context=context)
        if hasattr(self, "_tasks"):
            del self._tasks
        self._pending_tasks = {}
        self._ready_tasks = deque()
        self._is_spinning = False

    def create_task(self: Any, callback: Any, *args: Any, **kwargs: Any) -> Any:
        task = Task(callback, args, kwargs, executor=self)
        with self._tasks_lock:
            self._pending_tasks[task] = None
        self._call_task_in_next_spin(task)
        return task

    def call_task_in_next_spin(self: Any, task: Any) -> None:
        with self._tasks_lock:
            self._ready_tasks.append(task)
        self._guard.trigger()

    def wait_for(self: Any) -> Generator[Any, None, Any]:
        if self._pending():
            yield self
        if self._pending():
            raise RuntimeError("Future awaited a second time before it was done")
        return self.result()

    patch.setattr(Executor, "__init__", begin)
    patch.setattr(Executor, "create_task", create_task)
    patch.setattr(Executor, "_call_task_in_next_spin", call_task_in_next_spin, raising=False)
    patch.setattr(Future, "__await__", wait_for)
