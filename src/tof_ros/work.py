# SPDX-License-Identifier: Apache-2.0
"""A callback or a task of an executor: a coroutine that mostly ends at its first step, and may wait for futures."""

from __future__ import annotations

import inspect
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine

    from rclpy.task import Future


class Work:
    """One coroutine and what it waits for.

    rclpy up to 7.1.8 yields None while a future is pending; from 7.1.9 on it yields the future once and must not be resumed before
    that is done. Both are understood.
    """

    def __init__(
        self,
        coroutine: Coroutine[Any, None, Any],
        *,
        future: Future | None = None,
        awaited: Future | None = None,
        entity: Any = None,
    ) -> None:
        """`future` is to get the result; one that has begun waits for `awaited`, on behalf of the callback of an `entity`."""
        self._coroutine, self._future = coroutine, future
        self.awaited, self.entity = awaited, entity

    @property
    def can_go_on(self) -> bool:
        """Whether a step may be made: nothing is awaited, or what is awaited has ended."""
        cancelled = self._future is not None and self._future.cancelled()
        return cancelled or self.awaited is None or self.awaited.done() or self.awaited.cancelled()

    def step(self) -> bool:
        """Run up to the next wait; true where the work has ended. What the coroutine raises is kept in its future and raised."""
        future = self._future
        if future is not None and future.cancelled():
            self._coroutine.close()
            return True
        try:
            self.awaited = self._coroutine.send(None)
        except StopIteration as end:
            if future is not None:
                future.set_result(end.value)
            return True
        except Exception as error:
            if future is not None:
                future.set_exception(error)
                future.exception()  # as rclpy's executor: looked at, so that nothing is printed when it goes
            raise
        return False


async def called(callback: Callable[..., Any], *args: Any, **kwargs: Any) -> Any:
    """What a function returns, or what its coroutine returns at its end."""
    answer = callback(*args, **kwargs)
    return await answer if inspect.iscoroutine(answer) else answer
