# SPDX-License-Identifier: Apache-2.0
"""Compressed images as image_transport sends them, written from the formats' descriptions and nothing of the code under test."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, Any

import cv2

if TYPE_CHECKING:
    from numpy.typing import NDArray

CONFIG = struct.Struct("<iff")


def rvl(counts: NDArray[Any]) -> bytes:
    """RVL with its size before it: runs of zeros, runs of zigzag differences, three bits a nibble, eight nibbles a word."""
    values, flat, at, previous = [], [int(v) for v in counts.ravel()], 0, 0
    while at < len(flat):
        begin = at
        while at < len(flat) and flat[at] == 0:
            at += 1
        values.append(at - begin)
        begin = at
        while at < len(flat) and flat[at] != 0:
            at += 1
        values.append(at - begin)
        for value in flat[begin:at]:
            delta, previous = value - previous, value
            values.append(2 * delta if delta >= 0 else -2 * delta - 1)
    nibbles = []
    for value in values:
        while True:
            more = value > 7
            nibbles.append((value & 7) | (8 if more else 0))
            value >>= 3
            if not more:
                break
    nibbles += [0] * (-len(nibbles) % 8)
    words = [sum(n << (28 - 4 * i) for i, n in enumerate(nibbles[k : k + 8])) for k in range(0, len(nibbles), 8)]
    return struct.pack("<II", counts.shape[1], counts.shape[0]) + struct.pack(f"<{len(words)}I", *words)


def png(raster: NDArray[Any]) -> bytes:
    """A PNG; colour in the order blue, green, red."""
    return bytes(cv2.imencode(".png", raster)[1])


def jpeg(raster: NDArray[Any]) -> bytes:
    """A JPEG; colour in the order blue, green, red."""
    return bytes(cv2.imencode(".jpg", raster, [cv2.IMWRITE_JPEG_QUALITY, 95])[1])


def depth(counts: NDArray[Any], *, kind: str = "png", a: float = 0.0, b: float = 0.0) -> bytes:
    """A compressedDepth payload: twelve bytes of configuration, then the image."""
    return CONFIG.pack(0, a, b) + (png(counts) if kind == "png" else rvl(counts))
