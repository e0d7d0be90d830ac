# SPDX-License-Identifier: Apache-2.0
"""Treatment of freed memory: a node that handles images keeps it, the diagnosis of a session returns it to the system."""

from __future__ import annotations

import ctypes
from functools import cache
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

M_TRIM_THRESHOLD, M_MMAP_THRESHOLD, M_ARENA_MAX = -1, -3, -8
"""Numbers of glibc's `mallopt`."""
LARGEST_BLOCK = 32 * 2**20
"""Largest array in bytes that is kept: glibc's upper bound."""
KEPT = 512 * 2**20
"""Free bytes kept at the end of the heap: more than all images of a frame and the arrays computed from them."""


def keep_freed() -> bool:
    """Let malloc keep freed images for the next ones; False where the C library has no such setting (glibc has).

    By default an image of a megabyte goes back to the system when it is freed. The next one then faults in each of its pages again,
    which takes longer than to receive the image.
    """
    return _set({M_MMAP_THRESHOLD: LARGEST_BLOCK, M_TRIM_THRESHOLD: KEPT})


def one_heap() -> bool:
    """Let all threads that start from now on take memory from one heap; False where the C library has no such setting.

    By default each thread has a heap of its own, and images that one thread has freed there do not serve the others: 0.2 GB in a long
    session.
    """
    return _set({M_ARENA_MAX: 1})


def _set(values: Mapping[int, int]) -> bool:
    """Set parameters of malloc by number; False where the C library has no such setting."""
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (OSError, AttributeError):
        return False
    return all(mallopt(number, value) for number, value in values.items())


def give_back() -> None:
    """Return freed memory to the system; to be called once the images of a session's views are freed.

    glibc keeps freed arrays of up to 32 MB for later arrays of the same thread: a gigabyte in a long session. Does nothing with another
    C library.
    """
    _trim()(0)


@cache
def _trim() -> Callable[[int], int]:
    try:
        trim: Callable[[int], int] = ctypes.CDLL(None).malloc_trim
    except (OSError, AttributeError):
        return lambda _pad: 0
    return trim
