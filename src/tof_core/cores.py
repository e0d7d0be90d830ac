# SPDX-License-Identifier: Apache-2.0
"""Work shared out between the cores by threads: NumPy, the ray casters and our kernels let go of the interpreter."""

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
    """`work` of each item, as `map` has it, in order; what it raises is raised here."""
    if CORES == 1:
        return list(map(work, *each))
    with ThreadPoolExecutor(CORES) as pool:  # made anew: one kept at module level would not survive a fork
        return list(pool.map(work, *each))
