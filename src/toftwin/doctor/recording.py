# SPDX-License-Identifier: Apache-2.0
"""A bag read for the doctor: one pass over the camera's topics, with a few complete messages."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any
from zlib import crc32

import numpy as np

from tof_core.bag_files import deserialize, open_files
from tof_core.bag_index import BagIndex
from tof_core.tf import TransformBuffer

if TYPE_CHECKING:
    from pathlib import Path

    from tof_core.bag_files import BagFiles
    from tof_core.options import BagOptions
    from tof_core.topics import Topics

SAMPLES = 12
"""Frames that are decoded, spread over the bag."""
STAMP_END = 12
"""Bytes of CDR up to the end of the header's stamp; the content of the frame follows."""


@dataclass(slots=True)
class Stream:
    """One topic's messages in the order of stamps: stamps, log times (ns), and a checksum of the bytes after the stamp."""

    stamps: list[int] = field(default_factory=list)
    logged: list[int] = field(default_factory=list)
    content: list[int] = field(default_factory=list)
    kept: list[Any] = field(default_factory=list)

    @property
    def rate(self) -> float:
        """Messages a second by stamp, 0 where there are fewer than two."""
        gaps = np.diff(np.array(self.stamps, np.int64)).astype(np.float64)
        gaps = gaps[gaps > 0]
        return float(1e9 / np.median(gaps)) if len(gaps) else 0.0


class Recording:
    """An open bag with its index; `read` fills the streams of the topics found."""

    def __init__(self, path: Path | str, options: BagOptions) -> None:
        """Open and index; raises the same errors as the graph."""
        self.options = options
        self.files: BagFiles = open_files(path, recover=options.recover)
        try:
            self.transforms = TransformBuffer(options.max_gap_s)
            self.index = BagIndex(self.files, self.transforms, session=options.session)
        except BaseException:
            self.files.close()
            raise

    @property
    def types(self) -> dict[str, str]:
        """The type of each topic that has messages."""
        return {t.name: t.type for t in self.files.topics.values() if t.count}

    def read(self, topics: Topics) -> dict[str, Stream]:
        """One pass over the named topics: all stamps, all checksums, `SAMPLES` messages of each."""
        streams = {name: Stream() for name in topics.named()}
        every = {name: max(1, self.files.topics[name].count // SAMPLES) for name in streams}
        for m in self.index.ordered(topics.named()):
            stream = streams[m.topic]
            if len(stream.stamps) % every[m.topic] == 0:
                stream.kept.append(deserialize(self.files, m.topic, m.cdr))
            stream.stamps.append(m.stamp_ns)
            stream.logged.append(m.log_ns)
            stream.content.append(crc32(m.cdr[STAMP_END:]))
        return streams

    def close(self) -> None:
        """Close the files."""
        self.files.close()
