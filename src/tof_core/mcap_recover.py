# SPDX-License-Identifier: Apache-2.0
"""MCAP files without a footer, left by a killed recorder, read up to the last whole message.

Follows the MCAP specification (records of opcode, length, content; mcap.dev/spec).
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, field
from io import BytesIO
from typing import TYPE_CHECKING, BinaryIO

from tof_core.errors import BagError
from tof_core.unpack import unpack

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

MAGIC = b"\x89MCAP0\r\n"
SCHEMA, CHANNEL, MESSAGE, CHUNK, FOOTER, DATA_END = 0x03, 0x04, 0x05, 0x06, 0x02, 0x0F


@dataclass(frozen=True, slots=True)
class Channel:
    """A topic: its type, the type's definition, and the QoS its publisher offered (YAML)."""

    topic: str
    type: str
    definition: str
    qos: str = ""


@dataclass(slots=True)
class McapScan:
    """A file read from front to back; `channels` fills during the scan, `lost_bytes` is known at its end."""

    path: Path
    channels: dict[int, Channel] = field(default_factory=dict)
    schemas: dict[int, tuple[str, str]] = field(default_factory=dict)
    lost_bytes: int = 0

    def messages(self) -> Iterator[tuple[Channel, int, bytes]]:
        """(channel, log time in ns, CDR bytes) of every whole message, in file order."""
        with self.path.open("rb") as file:
            if file.read(8) != MAGIC:
                raise BagError("is no MCAP file", where=self.path)
            size = self.path.stat().st_size
            yield from self._records(file, size)

    def _records(self, file: BinaryIO, size: int) -> Iterator[tuple[Channel, int, bytes]]:
        while (head := file.read(9)) and len(head) == 9:
            opcode, length = struct.unpack("<BQ", head)
            if opcode in (FOOTER, DATA_END):
                return
            content = file.read(max(min(length, size - file.tell()), 0))  # a file still being written may be longer than `size`
            if len(content) < length:
                self.lost_bytes = len(content)
                if opcode != CHUNK:
                    return
            if opcode == CHUNK:
                inner, known = _open_chunk(content)
                yield from self._records(BytesIO(inner), len(inner))
                if not known:
                    self.lost_bytes += len(content)
            elif opcode == MESSAGE:
                channel_id, _, log_time, _ = struct.unpack_from("<HIQQ", content)
                if channel_id in self.channels:
                    yield self.channels[channel_id], log_time, content[22:]
            elif opcode == SCHEMA:
                key, rest = struct.unpack_from("<H", content)[0], content[2:]
                name, rest = _string(rest)
                _, rest = _string(rest)
                self.schemas[key] = name, _string(rest)[0]
            elif opcode == CHANNEL:
                self._channel(content)

    def _channel(self, content: bytes) -> None:
        key, schema = struct.unpack_from("<HH", content)
        topic, rest = _string(content[4:])
        _, rest = _string(rest)
        name, definition = self.schemas.get(schema, ("", ""))
        metadata = rest[4 : 4 + struct.unpack_from("<I", rest)[0]]
        pairs: dict[str, str] = {}
        while metadata:
            k, metadata = _string(metadata)
            pairs[k], metadata = _string(metadata)
        self.channels[key] = Channel(topic, name, definition, pairs.get("offered_qos_profiles", ""))


def _string(data: bytes) -> tuple[str, bytes]:
    """A length-prefixed text and the bytes after it."""
    length = struct.unpack_from("<I", data)[0]
    return data[4 : 4 + length].decode("utf-8", "replace"), data[4 + length :]


def _open_chunk(content: bytes) -> tuple[bytes, bool]:
    """The records in a chunk, and whether they could be read; of a truncated chunk, the records up to its end."""
    if len(content) < 40:
        return b"", False
    (size,) = struct.unpack_from("<Q", content, 16)
    compression, rest = _string(content[28:])
    try:
        return unpack(rest[8:], compression, size), True
    except Exception:  # noqa: BLE001 (whatever a damaged stream raises, only its chunk is lost)
        return b"", False
