# SPDX-License-Identifier: Apache-2.0
"""A bag's messages in the order of header stamps: one pass finds the order, a second streams the messages."""

from __future__ import annotations

import heapq
import struct
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from tof_core.bag_files import deserialize
from tof_core.bounds import LARGEST_TF_MESSAGE
from tof_core.compressed import stated_encoding
from tof_core.errors import BagError, TransformError
from tof_core.sessions import chosen, session_starts
from tof_core.tf_message import TYPE_HASH, read_transforms
from tof_core.topics import COMPRESSED, IMAGE, INFO, POINTS, TF

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from numpy.typing import NDArray
    from rosbags.interfaces import Qos

    from tof_core.bag_files import BagFiles
    from tof_core.tf import TransformBuffer


LATEST_NS = 2**62
"""Latest credible time in nanoseconds (year 2116); later ones are damaged."""


@dataclass(frozen=True, slots=True)
class RawMessage:
    """A message as it was recorded; `stamp_ns` is the header stamp, or the log time of a message without a header."""

    topic: str
    type: str
    stamp_ns: int
    log_ns: int
    cdr: bytes
    qos: tuple[Qos, ...] = ()


class BagIndex:
    """Stamps of every message, encoding and frame of every image topic; TF goes into `transforms`."""

    def __init__(self, files: BagFiles, transforms: TransformBuffer, *, lenient: bool = False, session: int = 0) -> None:
        """Read the bag once from front to back; `lenient` leaves damaged messages out instead of raising.

        A recording whose clock was set back has several sessions. One is read: number `session`, counted from 1; the longest for 0.
        """
        self._files, self._lenient = files, lenient
        self.left_out: Counter[str] = Counter()
        self._number = {name: i for i, name in enumerate(files.topics)}
        self._peek = {t.name: _peek_of(t.type, files) for t in files.topics.values()}
        self._usual_tf = _has_usual_tf(files)
        self._shift_ns = 0
        self.encodings: dict[str, str] = {}
        self.frame_ids: dict[str, str] = {}
        self.sessions: list[int] = []
        self.session = 0
        self._span = (-(2**63), 2**63 - 1)
        self._topic, self._stamp = self._scan(transforms, session)

    def count(self, topic: str) -> int:
        """Messages of a topic in the session that is read."""
        return int((self._topic == self._number[topic]).sum())

    @property
    def note(self) -> str:
        """Warning that the clock was set back, and which session is read; empty for one session."""
        if len(self.sessions) < 2:
            return ""
        sizes = ", ".join(map(str, self.sessions))
        return (
            f"the clock was set back: {len(self.sessions)} sessions (images, clouds and CameraInfos: {sizes}); "
            f"session {self.session + 1} is read, --session N reads another"
        )

    def ordered(self, topics: tuple[str, ...] = ()) -> Iterator[RawMessage]:
        """Messages of the named topics (of all, where none is named): latched ones first, then by header stamp.

        At one stamp, images and clouds come after the messages that are joined with them. Only messages recorded
        out of order are held in memory.
        """
        names = [n for n in self._files.topics if not topics or n in topics]
        latched = [n for n in names if is_latched(n)]
        if latched:
            yield from (self._message(*m) for m in self._files.messages(latched))
        rest = [n for n in names if not is_latched(n)]
        if not rest:
            return
        due = iter(self._keys(rest))
        expected = next(due, None)
        held: list[tuple[tuple[int, int, int], int, RawMessage]] = []
        low, high = self._span
        for arrival, (name, log_ns, raw) in enumerate(self._files.messages(rest)):
            if not low <= min(log_ns, LATEST_NS) < high:
                continue
            message = self._message(name, log_ns, raw)
            heapq.heappush(held, (self._key(name, message.stamp_ns), arrival, message))
            while held and held[0][0] == expected:
                yield heapq.heappop(held)[2]
                expected = next(due, None)
        yield from (heapq.heappop(held)[2] for _ in range(len(held)))

    def _scan(self, transforms: TransformBuffer, session: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        rows: list[tuple[int, int, int]] = []
        for name, log_ns, raw in self._files.messages():
            rows.append((self._number[name], self._peek[name](raw), min(log_ns, LATEST_NS)))
            try:
                self._look_into(name, raw, transforms)
            except BagError:
                if not self._lenient:
                    raise
                self.left_out["damaged"] += 1
            except TransformError:
                self.left_out["no rigid motion"] += 1
        table = np.array(rows, np.int64).reshape(-1, 3)
        table = table[self._cut(table, session, transforms)]
        stamp, log = table[:, 1].copy(), table[:, 2]
        stamped = stamp > 0
        if stamped.any():
            # A bag of simulated time is logged in another clock than it is stamped in.
            self._shift_ns = int(np.median((stamp - log)[stamped]))
        stamp[~stamped] = log[~stamped] + self._shift_ns
        return table[:, 0], stamp

    def _cut(self, table: NDArray[np.int64], session: int, transforms: TransformBuffer) -> NDArray[np.bool_]:
        """Which rows (topic, stamp, log time) belong to the session that is read; transforms of other sessions are dropped."""
        topic, stamp, log = table.T
        counted = {self._number[t.name] for t in self._files.topics.values() if t.type in (IMAGE, COMPRESSED, POINTS, INFO)}
        edges = [-(2**63), *session_starts(topic, stamp, log, counted), 2**63 - 1]
        seen = np.isin(topic, list(counted))
        self.sessions = [int((seen & (log >= a) & (log < b)).sum()) for a, b in pairwise(edges)]
        self.session = chosen(self.sessions, session, self._files.path)
        if len(self.sessions) < 2:
            return np.ones(len(table), bool)
        low, high = self._span = edges[self.session], edges[self.session + 1]
        transforms.clear_dynamic()
        for name, log_ns, raw in self._files.messages(
            [t.name for t in self._files.topics.values() if t.type == TF and not is_latched(t.name)]
        ):
            if low <= min(log_ns, LATEST_NS) < high:
                with suppress(BagError, TransformError):  # counted in the first pass
                    self._look_into(name, raw, transforms)
        latched = [self._number[name] for name in self._files.topics if is_latched(name)]
        return np.asarray(((log >= low) & (log < high)) | np.isin(topic, latched))

    def _look_into(self, name: str, raw: bytes, transforms: TransformBuffer) -> None:
        """Store transforms, and the encoding and frame of the first message of each image topic."""
        kind = self._files.topics[name].type
        if kind == TF:
            self._record(name, raw, transforms)
        elif kind in (IMAGE, COMPRESSED) and name not in self.encodings:
            first: Any = deserialize(self._files, name, raw)
            self.frame_ids[name] = first.header.frame_id.lstrip("/")
            self.encodings[name] = first.encoding if kind == IMAGE else stated_encoding(first.format)

    def _record(self, name: str, raw: bytes, transforms: TransformBuffer) -> None:
        """Store the transforms of a message; one that is not whole is left to the deserialiser, whose error names the topic."""
        sent = None
        if self._usual_tf and len(raw) <= LARGEST_TF_MESSAGE:
            with suppress(TransformError):
                sent = read_transforms(raw, whole=True)
        if sent is None:
            transforms.add_message(deserialize(self._files, name, raw), static=is_latched(name))
            return
        for transform in sent:
            transforms.put(transform, static=is_latched(name))

    def _message(self, name: str, log_ns: int, raw: bytes) -> RawMessage:
        info = self._files.topics[name]
        stamp = self._peek[name](raw)
        return RawMessage(name, info.type, stamp if stamp > 0 else log_ns + self._shift_ns, log_ns, raw, info.qos)

    def _key(self, name: str, stamp: int) -> tuple[int, int, int]:
        return stamp, int(self._files.topics[name].type in (IMAGE, COMPRESSED, POINTS)), self._number[name]

    def _keys(self, names: list[str]) -> list[tuple[int, int, int]]:
        """The keys of all messages of some topics, sorted."""
        by_number = {self._number[n]: n for n in names}
        chosen = np.isin(self._topic, list(by_number))
        return sorted(self._key(by_number[t], s) for t, s in zip(self._topic[chosen].tolist(), self._stamp[chosen].tolist(), strict=True))


def is_latched(topic: str) -> bool:
    """Whether a topic's messages hold for the whole recording."""
    return topic.endswith("tf_static")


def _has_usual_tf(files: BagFiles) -> bool:
    """Whether the bag's TFMessage has the fields of ROS 2's; a bag brings its own definitions."""
    try:
        return TF in files.types.fielddefs and files.types.hash_rihs01(TF) == TYPE_HASH
    except Exception:  # noqa: BLE001 (a foreign definition may lack types, or contain itself)
        return False


def _peek_of(kind: str, files: BagFiles) -> Callable[[bytes], int]:
    """A function that reads the header stamp from a message's bytes; 0 for a type without a header.

    In CDR a leading Header begins with its stamp; a TFMessage with the length of its list.
    """
    if kind == TF:
        return lambda raw: _stamp_at(raw, 8) if len(raw) >= 16 and any(raw[4:8]) else 0
    fields = files.types.fielddefs.get(kind, ([], []))[1]
    if fields and fields[0][1][1] == "std_msgs/msg/Header":
        return lambda raw: _stamp_at(raw, 4)
    return lambda raw: 0  # noqa: ARG005


def _stamp_at(raw: bytes, offset: int) -> int:
    if len(raw) < offset + 8:
        return 0
    sec, nanosec = struct.unpack_from("<iI" if raw[1] & 1 else ">iI", raw, offset)
    return int(sec) * 1_000_000_000 + int(nanosec)
