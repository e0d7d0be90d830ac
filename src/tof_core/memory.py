# SPDX-License-Identifier: Apache-2.0
"""How freed memory is treated: a process that handles images keeps it."""

from __future__ import annotations

import ctypes

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
