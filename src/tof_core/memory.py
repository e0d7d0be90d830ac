# SPDX-License-Identifier: Apache-2.0
"""How freed memory is treated: a node that handles images keeps it, the diagnosis of a session gives it back."""

from __future__ import annotations

import ctypes
from functools import cache
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

M_TRIM_THRESHOLD, M_MMAP_THRESHOLD = -1, -3
"""Numbers of glibc's `mallopt`."""
LARGEST_BLOCK = 32 * 2**20
"""Bytes; the most that glibc takes. Larger arrays have a mapping of their own as before."""
KEPT = 512 * 2**20
"""Bytes that may lie free at the end of the heap: more than all images of a frame and what is computed from them."""


def keep_freed() -> bool:
    """Let malloc keep freed images for the next ones; whether the C library knows how (glibc does).

    By default an image of a megabyte is a mapping, or the heap's end, that goes back to the system when it is freed: the next one
    faults in each of its pages again, which takes longer than to receive it.
    """
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (OSError, AttributeError):
        return False
    return bool(mallopt(M_MMAP_THRESHOLD, LARGEST_BLOCK)) and bool(mallopt(M_TRIM_THRESHOLD, KEPT))


def give_back() -> None:
    """Give freed memory back to the system; to be called where the images of all views of a session have gone.

    glibc keeps freed arrays of up to 32 MB for later ones of the same thread, and threads do not share them: of a long session that is a
    gigabyte. Does nothing under another C library.
    """
    _trim()(0)


@cache
def _trim() -> Callable[[int], int]:
    try:
        trim: Callable[[int], int] = ctypes.CDLL(None).malloc_trim
    except (OSError, AttributeError):
        return lambda _pad: 0
    return trim
