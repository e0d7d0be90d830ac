# SPDX-License-Identifier: Apache-2.0
"""The cores of this process: work distributed over them by threads, or linear algebra held to one thread."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    T = TypeVar("T")

CORES = len(os.sched_getaffinity(0))
"""Cores that this process may use."""

ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")
"""Environment of a process whose linear algebra and kernels take one thread.

On small matrices more threads gain nothing, and they take the cores of other processes while they wait for each other.
"""


def one_thread() -> None:
    """Set `ONE_THREAD` where the environment does not say otherwise; NumPy reads it when it is imported, so call this before."""
    for name, value in ONE_THREAD.items():
        os.environ.setdefault(name, value)


def in_threads(work: Callable[..., T], *each: Iterable[object]) -> list[T]:
    """Apply `work` to each item in threads; results in order, like `map`. An exception of `work` is raised here.

    NumPy, the ray casters and the compiled kernels release the interpreter lock.
    """
    if CORES == 1:
        return list(map(work, *each))
    with ThreadPoolExecutor(CORES) as pool:  # made anew: one kept at module level would not survive a fork
        return list(pool.map(work, *each))
