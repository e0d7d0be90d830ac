# SPDX-License-Identifier: Apache-2.0
"""Work distributed over the cores by threads: NumPy, the ray casters and the compiled kernels release the interpreter lock."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    T = TypeVar("T")

CORES = len(os.sched_getaffinity(0))
"""Cores that this process may use."""


def in_threads(work: Callable[..., T], *each: Iterable[object]) -> list[T]:
    """Apply `work` to each item in threads; results in order, like `map`. An exception of `work` is raised here."""
    if CORES == 1:
        return list(map(work, *each))
    with ThreadPoolExecutor(CORES) as pool:  # made anew: one kept at module level would not survive a fork
        return list(pool.map(work, *each))
