# SPDX-License-Identifier: Apache-2.0
"""A bag's files: rosbags opens whole ones; unfinished ones are read up to the last whole message."""

from __future__ import annotations

import shutil
import sqlite3
from collections import Counter
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, Protocol, cast

from tof_core.bag_yaml import use_libyaml
from tof_core.bounds import LARGEST_MESSAGE, LARGEST_METADATA, LARGEST_TF_MESSAGE
from tof_core.errors import BagError, ConfigError, NoBagError, ToftwinError
from tof_core.mcap_recover import McapScan
from tof_core.topics import TF
from tof_core.typestores import JazzyWhenAsked
from tof_core.unpack import UNPACKERS, BoundedZstd
from tof_core.yamlio import load_yaml

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator

    from rosbags.highlevel import AnyReader
    from rosbags.interfaces import Qos
    from rosbags.typesys.store import Typestore


MOST_ELEMENTS = 4096
"""Strings or messages in the fixed arrays of one message type; types in use have a few."""


@dataclass(frozen=True, slots=True)
class TopicInfo:
    """One topic of a bag."""

    name: str
    type: str
    count: int
    qos: tuple[Qos, ...] = ()


class BagFiles(Protocol):
    """What a bag reader needs of its files."""

    path: Path
    topics: dict[str, TopicInfo]
    types: Typestore
    note: str

    def messages(self, topics: Collection[str] = ()) -> Iterator[tuple[str, int, bytes]]:
        """(topic, log time in ns, CDR bytes) in the order of the recording; all topics where none is named."""

    def close(self) -> None:
        """Close the files."""


class WholeBag:
    """A finished bag, or files that rosbags can open as they are."""

    def __init__(self, path: Path, files: list[Path], stack: ExitStack, note: str = "") -> None:
        """Open with rosbags; types come from the bag, or from Jazzy where the bag embeds none."""
        from rosbags.highlevel import AnyReader
        from rosbags.rosbag2 import reader, storage_mcap

        use_libyaml()
        storage_mcap.DECOMPRESSORS.update(UNPACKERS)
        vars(reader)["zstd"] = BoundedZstd()
        self.path, self.note, self._stack = path, note, stack
        self._reader: AnyReader = stack.enter_context(AnyReader(files, default_typestore=cast("Typestore", JazzyWhenAsked())))
        self.types = self._reader.typestore
        counts: Counter[str] = Counter()
        for c in self._reader.connections:
            counts[c.topic] += c.msgcount
        self.topics = {
            c.topic: TopicInfo(c.topic, c.msgtype, counts[c.topic], tuple(getattr(c.ext, "offered_qos_profiles", ())))
            for c in self._reader.connections
        }

    def messages(self, topics: Collection[str] = ()) -> Iterator[tuple[str, int, bytes]]:
        """(topic, log time in ns, CDR bytes) in the order of the recording."""
        wanted = [c for c in self._reader.connections if not topics or c.topic in topics]
        if not wanted:
            return
        with _one_line(self.path):
            for connection, log_ns, raw in self._reader.messages(connections=wanted):
                yield connection.topic, log_ns, raw

    def close(self) -> None:
        """Close the files."""
        self._stack.close()


class UnfinishedBag:
    """MCAP files without a footer; every pass reads them from the front."""

    def __init__(self, path: Path, files: list[Path]) -> None:
        """Scan once: topics, counts, what is lost."""
        from rosbags.rosbag2.metadata import parse_qos

        use_libyaml()
        self.path, self._files = path, files
        counts: Counter[str] = Counter()
        scans = [McapScan(file) for file in files]
        for scan in scans:
            counts.update(channel.topic for channel, _, _ in scan.messages())
        channels = [c for scan in scans for c in scan.channels.values()]
        self.topics = {c.topic: TopicInfo(c.topic, c.type, counts[c.topic], tuple(parse_qos(c.qos))) for c in channels}
        self.types = _types_of({c.type: c.definition for c in channels})
        lost = sum(scan.lost_bytes for scan in scans)
        self.note = f"recording was not finished: {sum(counts.values())} messages are whole, {lost} bytes after them are lost"

    def messages(self, topics: Collection[str] = ()) -> Iterator[tuple[str, int, bytes]]:
        """(topic, log time in ns, CDR bytes) in the order of the recording; topics that the files gained since they were opened are left out."""
        wanted = topics or self.topics
        for file in self._files:
            for channel, log_ns, raw in McapScan(file).messages():
                if channel.topic in wanted:
                    yield channel.topic, log_ns, raw

    def close(self) -> None:
        """Nothing is held open."""


def open_files(path: Path | str, *, recover: bool = False) -> BagFiles:
    """Open a bag: a folder with metadata.yaml, a folder that a killed recorder left, or one file.

    Raises:
        BagError: nothing there, no bag, or damaged (and `recover` not asked for).
    """
    path = Path(path)
    if not path.exists():
        raise NoBagError("does not exist", where=path, todo="name a bag's folder, .mcap or .db3 file")
    files = _storage_files(path)
    if path.is_dir() and (path / "metadata.yaml").exists():
        try:
            with _one_line(path):
                _check_metadata(path)
            return _whole(path, [path])
        except BagError as error:
            if not recover or not files:
                raise _with_hint(error, files) from None
    if not files:
        packed = path.is_dir() and any(path.glob("*.zstd"))
        todo = "unpack its .zstd files first" if packed else "name the folder that holds metadata.yaml"
        raise BagError("is no bag (no .mcap and no .db3 file)", where=path, todo=todo)
    return _unfinished(path, files)


def _check_metadata(path: Path) -> None:
    """Refuse a metadata.yaml that is large, swells by aliases, or names a storage file twice or one that is no file."""
    file = path / "metadata.yaml"
    if file.stat().st_size > LARGEST_METADATA:
        raise BagError(f"its metadata.yaml is larger than {LARGEST_METADATA} bytes", where=path)
    try:
        facts = load_yaml(file).get("rosbag2_bagfile_information")
    except ConfigError as error:
        raise BagError(error.what, where=error.where, todo=error.todo) from None
    names = [Path(str(name)).name for name in (facts or {}).get("relative_file_paths") or ()]
    if len(set(names)) < len(names):
        raise BagError("its metadata.yaml names a storage file twice", where=path)
    if odd := [name for name in names if (path / name).exists() and not (path / name).is_file()]:
        raise BagError(f"its storage file {odd[0]} is no regular file", where=path)


def _storage_files(path: Path) -> list[Path]:
    """The storage files in the order of the recording (name_0, name_1, ..., name_10)."""
    files = [path] if path.is_file() else [p for p in path.iterdir() if p.suffix in (".mcap", ".db3")]
    return sorted((p for p in files if p.suffix in (".mcap", ".db3")), key=lambda p: (len(p.name), p.name))


def _unfinished(path: Path, files: list[Path]) -> BagFiles:
    with _one_line(path):
        if files[0].suffix == ".db3":
            return _sqlite(path, files)
        try:
            return _whole(path, files)
        except BagError:
            return UnfinishedBag(path, files)


def _whole(path: Path, files: list[Path]) -> WholeBag:
    stack = ExitStack()
    try:
        with _one_line(path):
            return WholeBag(path, [_by_another_name(f, stack) for f in files], stack)
    except BagError:
        stack.close()
        raise


def _by_another_name(path: Path, stack: ExitStack) -> Path:
    """The path, or a link to a folder called `run.bag`: by that name rosbags would take the folder for a ROS 1 file."""
    if path.suffix != ".bag" or not path.is_dir():
        return path
    link = Path(stack.enter_context(TemporaryDirectory())) / "bag"
    link.symlink_to(path.resolve())
    return link


def _sqlite(path: Path, files: list[Path]) -> WholeBag:
    """sqlite3 files; those with a journal are copied, so that SQLite can repair the copy."""
    stack = ExitStack()
    if any(f.with_name(f.name + end).exists() for f in files for end in ("-wal", "-journal")):
        folder = Path(stack.enter_context(TemporaryDirectory()))
        for f in files:
            for part in f.parent.glob(f.name + "*"):
                shutil.copy(part, folder)
            with sqlite3.connect(folder / f.name) as db:
                db.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        files = [folder / f.name for f in files]
    return WholeBag(path, files, stack, note="recording was not finished")


def _types_of(definitions: dict[str, str]) -> Typestore:
    """The types that a file defines, over Jazzy's."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    types = get_typestore(Stores.ROS2_JAZZY)
    for name, text in definitions.items():
        if name not in types.fielddefs and text and not text.startswith("="):
            types.register(get_types_from_msg(text, name))
    return types


def _with_hint(error: BagError, files: list[Path]) -> BagError:
    """The same error; of a truncated MCAP file with the number of messages that --recover reads."""
    if not files or files[0].suffix != ".mcap":
        return error
    try:
        whole = sum(1 for file in files for _ in McapScan(file).messages())
    except Exception:  # noqa: BLE001 (only a hint; the error stands)
        whole = 0
    return BagError(error.what, where=error.where, todo=f"copy it again, or pass --recover to read the {whole} messages that are whole")


def deserialize(files: BagFiles, topic: str, cdr: bytes) -> Any:
    """The fields of a message; bytes that are no message of the topic's type raise a BagError that names the topic."""
    with _one_line(f"{files.path}, topic {topic}"):
        kind = files.topics[topic].type
        most = LARGEST_TF_MESSAGE if kind == TF else LARGEST_MESSAGE
        if len(cdr) > most:
            raise BagError(f"holds a message of {len(cdr)} bytes", todo=f"of {kind} up to {most} are read")
        if kind not in files.types.cache:
            _check_definition(files.types, kind)
        return files.types.deserialize_cdr(cdr, kind)


def _check_definition(types: Typestore, kind: str) -> None:
    """Refuse a definition with large fixed arrays of strings or messages: rosbags writes code for each element, which takes minutes."""
    from rosbags.interfaces import Nodetype

    elements = 0
    fields: list[tuple[str, Any]] = list(types.fielddefs[kind][1])
    for _, (node, what) in fields:
        inner, length = what if node in (Nodetype.ARRAY, Nodetype.SEQUENCE) else ((node, what), 0)
        if node == Nodetype.ARRAY and (inner[0] == Nodetype.NAME or inner[1][0] == "string"):
            elements += int(length)
        if inner[0] == Nodetype.NAME and inner[1] not in types.cache:
            _check_definition(types, inner[1])
    if elements > MOST_ELEMENTS:
        raise BagError(f"defines {kind} with {elements} elements of fixed arrays", todo="such a type is not read")


@contextmanager
def _one_line(path: object) -> Iterator[None]:
    """Whatever rosbags, SQLite or a decompressor raise over foreign bytes becomes one BagError that names the bag."""
    try:
        yield
    except BagError as error:
        if error.where:
            raise
        raise BagError(error.what, where=path, todo=error.todo) from None
    except (ToftwinError, GeneratorExit):
        raise
    except Exception as error:  # noqa: BLE001 (foreign bytes, foreign parsers: any error is possible)
        raise BagError(f"is damaged or no bag: {str(error) or type(error).__name__}", where=path) from None
