# SPDX-License-Identifier: Apache-2.0
"""A job at a time in a thread of its own, for at most a share of a core."""

from __future__ import annotations

import time
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TYPE_CHECKING

from tof_core.cores import thread_seconds

if TYPE_CHECKING:
    from collections.abc import Callable


class SpareTime:
    """Takes a job while none is in progress and the share of a core is not used up, and refuses it otherwise.

    A job that used t seconds of processor, in its own thread and in those of `in_threads`, is followed by another t / share seconds after
    its own begin at the soonest. What other nodes of this process do meanwhile does not count.
    """

    def __init__(self, share: float) -> None:
        """`share` of a core that jobs use at most, above 0 and up to 1."""
        self._share, self._rests_until = share, float("-inf")
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="spare")
        self._job: Future[None] | None = None

    def take(self, job: Callable[[], None]) -> bool:
        """Begin a job; false where it is refused.

        Raises:
            Exception: what the job before raised.
        """
        if self._job is not None:
            if not self._job.done():
                return False
            self.finish()
        if time.monotonic() < self._rests_until:
            return False
        self._job = self._thread.submit(self._timed, job)
        return True

    def finish(self) -> None:
        """Wait for the job in progress.

        Raises:
            Exception: what it raised.
        """
        job, self._job = self._job, None
        if job is not None:
            job.result()

    def close(self) -> None:
        """Wait for the job in progress; no other is taken."""
        self._thread.shutdown()

    def _timed(self, job: Callable[[], None]) -> None:
        began, used = time.monotonic(), thread_seconds()
        try:
            job()
        finally:
            self._rests_until = began + (thread_seconds() - used) / self._share
