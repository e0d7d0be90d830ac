# SPDX-License-Identifier: Apache-2.0
"""Decompression of foreign files, bounded by the size that their header states."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tof_core.errors import BagError

if TYPE_CHECKING:
    from collections.abc import Callable

LARGEST_CHUNK = 256_000_000
"""Bytes in a chunk of an MCAP file; recorders write 0.8 to 4 million. Thirty kilobytes of zstd can stand for a gigabyte."""


def unpack(data: bytes, compression: str, size: int) -> bytes:
    """The content of a chunk that is said to hold `size` bytes; `zstd`, `lz4` or none.

    Raises:
        BagError: larger than any recorder writes, or than it says; another compression.
    """
    if size > LARGEST_CHUNK:
        raise BagError(f"holds a chunk of {size} bytes", todo=f"chunks of up to {LARGEST_CHUNK} bytes are read")
    if compression == "zstd":
        from backports.zstd import ZstdDecompressor

        raw = bytes(ZstdDecompressor().decompress(data, size + 1))
    elif compression == "lz4":
        from lz4.frame import LZ4FrameDecompressor  # type: ignore[import-untyped]

        raw = bytes(LZ4FrameDecompressor().decompress(data, size + 1))
    elif compression == "":
        raw = data
    else:
        raise BagError(f"holds a chunk packed with '{compression}'", todo="zstd and lz4 are read")
    if len(raw) > size:
        raise BagError(f"holds a chunk that is larger than the {size} bytes it says")
    return raw


UNPACKERS: dict[str, Callable[[bytes, int], bytes]] = {
    name: lambda data, size, name=name: unpack(data, name, size)  # type: ignore[misc]
    for name in ("", "zstd", "lz4")
}
"""In the form of rosbags' own table."""
