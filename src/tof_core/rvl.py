# SPDX-License-Identifier: Apache-2.0
"""RVL, the lossless depth code of compressedDepth topics (Wilson, "Fast Lossless Depth Image Compression", ISS 2017)."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING

import numpy as np
from numba import njit

from tof_core.errors import DecodeError
from tof_core.png import check_raster

if TYPE_CHECKING:
    from numpy.typing import NDArray

_SIZE = struct.Struct("<II")  # columns, rows


def rvl_size(data: bytes, where: object = "") -> tuple[int, int]:
    """Width and height in pixels from the image's first eight bytes, checked by `check_raster`.

    Raises:
        DecodeError: cut off, or too large.
    """
    if len(data) < _SIZE.size:
        raise DecodeError("is cut off within its header", where=where)
    width, height = _SIZE.unpack_from(data)
    check_raster(width, height, where)
    return width, height


def decode_rvl(data: bytes, where: object = "") -> NDArray[np.uint16]:
    """The counts (H, W) uint16 of an RVL image that begins with its size.

    Raises:
        DecodeError: cut off, too large, or damaged.
    """
    width, height = rvl_size(data, where)
    words = np.frombuffer(data, "<u4", count=(len(data) - _SIZE.size) // 4, offset=_SIZE.size)
    counts = np.zeros(width * height, np.uint16)
    if not _unpack(words, counts):
        raise DecodeError(f"is no RVL image of {width}x{height} pixels, or is cut off", where=where)
    return counts.reshape(height, width)


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator, unused-ignore]
def _unpack(words: NDArray[np.uint32], counts: NDArray[np.uint16]) -> bool:
    """Runs of zeros and of differences until all pixels are decoded; False where the words end before, or a run reaches beyond.

    A value is a chain of nibbles, the most significant of a word first: three bits each, the least significant first. The fourth bit
    says that another nibble follows. Differences are in zigzag code (0, -1, 1, -2, ...).
    """
    total, ends = counts.size, words.size * 8
    nibble, pixel, previous = 0, 0, 0
    left, phase = 0, 0  # phase 0: a run of zeros is next, 1: a run of differences, 2: within one
    while pixel < total:
        value, shift = 0, 0
        while True:
            if nibble >= ends or shift > 30:
                return False
            bits = (int(words[nibble >> 3]) >> (28 - 4 * (nibble & 7))) & 15
            nibble += 1
            value |= (bits & 7) << shift
            shift += 3
            if bits < 8:
                break
        if phase == 2:
            previous = (previous + ((value >> 1) ^ -(value & 1))) & 0xFFFF
            counts[pixel] = previous
            pixel += 1
            left -= 1
            if left == 0:
                phase = 0
        else:
            if value > total - pixel:
                return False
            if phase == 0:
                pixel += value
                phase = 1
            else:
                left = value
                phase = 2 if value else 0
    return True


def encode_rvl(counts: NDArray[np.uint16]) -> bytes:
    """Counts (H, W) uint16 as an RVL image that begins with its size."""
    height, width = counts.shape
    words = np.zeros(counts.size + SLACK_WORDS, np.uint32)
    used = _pack(np.ascontiguousarray(counts).reshape(-1), words)
    return _SIZE.pack(width, height) + words[:used].astype("<u4").tobytes()


SLACK_WORDS = 4
"""Words beyond one per pixel: a difference takes at most six nibbles, the runs around a single pixel two, a long run seven more."""


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator, unused-ignore]
def _put(words: NDArray[np.uint32], nibble: int, value: int) -> int:
    """Append a value to the chain of nibbles; the place after it."""
    while True:
        bits = value & 7
        value >>= 3
        if value:
            bits |= 8
        words[nibble >> 3] |= np.uint32(bits << (28 - 4 * (nibble & 7)))
        nibble += 1
        if not value:
            return nibble


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator, unused-ignore]
def _pack(counts: NDArray[np.uint16], words: NDArray[np.uint32]) -> int:
    """The inverse of `_unpack`, written into words that are zero; the number of words used."""
    nibble, at, previous, total = 0, 0, 0, counts.size
    while at < total:
        begin = at
        while at < total and counts[at] == 0:
            at += 1
        nibble = _put(words, nibble, at - begin)
        begin = at
        while at < total and counts[at] != 0:
            at += 1
        nibble = _put(words, nibble, at - begin)
        for pixel in range(begin, at):
            difference = int(counts[pixel]) - previous
            previous = int(counts[pixel])
            nibble = _put(words, nibble, (difference << 1) ^ (difference >> 63))
    return (nibble + 7) // 8
