# SPDX-License-Identifier: Apache-2.0
"""Decompression of foreign files, limited beforehand: by the size that a header states, or by a fixed bound."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any, BinaryIO, Literal

from tof_core.bounds import LARGEST_CHUNK, LARGEST_MESSAGE, LARGEST_RATIO, LARGEST_STORAGE
from tof_core.errors import BagError

if TYPE_CHECKING:
    from collections.abc import Callable


def unpack(data: bytes, compression: str, size: int) -> bytes:
    """The content of a chunk whose header states `size` bytes; `zstd`, `lz4` or none.

    Raises:
        BagError: larger than any recorder writes, or than its header states; another compression.
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
        raise BagError(f"holds a chunk that is larger than the {size} bytes that its header states")
    return raw


UNPACKERS: dict[str, Callable[[bytes, int], bytes]] = {
    name: lambda data, size, name=name: unpack(data, name, size)  # type: ignore[misc]
    for name in ("", "zstd", "lz4")
}
"""In the form of rosbags' own table."""


def unzstd(data: bytes, most: int = LARGEST_MESSAGE) -> bytes:
    """The content of one zstd frame, of at most `most` bytes.

    Raises:
        BagError: larger, cut off, or no zstd.
    """
    from backports.zstd import ZstdDecompressor, ZstdError

    frame = ZstdDecompressor()
    try:
        raw = bytes(frame.decompress(data, most + 1))
    except ZstdError as error:
        raise BagError(f"holds damaged zstd ({error})") from None
    if len(raw) > most:
        raise BagError(f"holds a compressed message of more than {most} bytes")
    if not frame.eof:
        raise BagError("holds a compressed message that is cut off")
    return raw


class BoundedZstd:
    """Replaces the zstd module in rosbags' reader of a folder; limits the unpacked bytes of all storage files together."""

    def __init__(self) -> None:
        """Nothing unpacked yet."""
        self._unpacked, self._allowed = 0, 0

    @staticmethod
    def decompress(data: bytes) -> bytes:
        """A message, as of `unzstd`."""
        return unzstd(data)

    def open(self, packed: BinaryIO, mode: Literal["rb"]) -> Any:
        """A storage file, as of zstd's own `open`, whose `read` fails beyond the limit."""
        from backports import zstd

        self._allowed += LARGEST_RATIO * os.fstat(packed.fileno()).st_size
        file: Any = zstd.open(packed, mode)
        read = file.read
        file.read = lambda size=-1: self._count(read(size))
        return file

    def _count(self, data: bytes) -> bytes:
        self._unpacked += len(data)
        if self._unpacked > max(LARGEST_STORAGE, self._allowed):
            raise BagError(
                f"its compressed files unpack to more than {max(LARGEST_STORAGE, self._allowed)} bytes",
                todo="unpack them with zstd -d if this is right",
            )
        return data
