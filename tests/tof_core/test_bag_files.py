# SPDX-License-Identifier: Apache-2.0
"""Bags as other recorders leave them: compressed, split, without definitions, in sqlite's journals."""

from __future__ import annotations

import shutil
import sqlite3
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from tests.tof_core import bags
from tests.tof_core.bags import Session, depth_of, stamp
from tof_core.bag import open_bag

if TYPE_CHECKING:
    from pathlib import Path

    from tof_core.bag import RawMessage


def recorded(path: Path, session: Session | None = None) -> tuple[list[RawMessage], Any]:
    """The messages of a good bag, in order, and their types."""
    with open_bag(bags.write(path, session)) as reader:
        return list(reader.messages()), reader._files.types


def check(path: Path, frames: int = 6) -> None:
    with open_bag(path, cell_frame="cell") as reader:
        captures = list(reader.captures())
    assert [c.stamp_ns for c in captures] == [stamp(i) for i in range(frames)]
    for i, c in enumerate(captures):
        np.testing.assert_allclose(c.depth, depth_of(i), atol=5.1e-4)


@pytest.mark.parametrize(
    ("plugin", "mode"),
    [
        ("MCAP", "NONE"),
        ("MCAP", "MESSAGE"),
        ("MCAP", "FILE"),
        ("MCAP", "STORAGE"),
        ("SQLITE3", "NONE"),
        ("SQLITE3", "MESSAGE"),
        ("SQLITE3", "FILE"),
    ],
)
@pytest.mark.parametrize("version", [8, 9])
def test_every_way_to_compress_a_bag(tmp_path: Path, plugin: str, mode: str, version: Any) -> None:
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.rosbag2.enums import CompressionFormat, CompressionMode

    messages, types = recorded(tmp_path / "source")
    writer = Writer(tmp_path / "bag", version=version, storage_plugin=StoragePlugin[plugin])
    writer.set_compression(CompressionMode[mode], CompressionFormat.ZSTD)
    with writer:
        kinds = {m.topic: m.type for m in messages}
        topics = {name: writer.add_connection(name, kind, typestore=types) for name, kind in kinds.items()}
        for m in messages:
            writer.write(topics[m.topic], m.log_ns, m.cdr)
    check(tmp_path / "bag")


def test_a_folder_may_be_called_as_ros_1_called_its_files(tmp_path: Path) -> None:
    bags.write(tmp_path / "run.bag")
    check(tmp_path / "run.bag")
    with open_bag(tmp_path / "run.bag") as reader:
        assert reader._files.path == tmp_path / "run.bag"


@pytest.mark.parametrize("finished", [True, False])
def test_a_recording_split_into_files(tmp_path: Path, finished: bool) -> None:  # noqa: FBT001
    from rosbags.rosbag2 import StoragePlugin, Writer

    messages, types = recorded(tmp_path / "source", Session(frames=12, tf_to=1.2))
    folder = tmp_path / "bag"
    folder.mkdir()
    for part in range(3):
        writer = Writer(tmp_path / f"part{part}", version=9, storage_plugin=StoragePlugin.MCAP)
        writer.open()
        mine = messages[part * len(messages) // 3 : (part + 1) * len(messages) // 3]
        topics = {n: writer.add_connection(n, k, typestore=types) for n, k in {m.topic: m.type for m in mine}.items()}
        for m in mine:
            writer.write(topics[m.topic], m.log_ns, m.cdr)
        if part == 2 and not finished:
            writer.storage.close_chunk()  # type: ignore[union-attr]
            writer.abort()
        else:
            writer.close()
        shutil.copy(tmp_path / f"part{part}" / f"part{part}.mcap", folder / f"bag_{part}.mcap")
    check(folder, 12)


def test_a_bag_without_definitions_is_read_with_the_default_types(tmp_path: Path) -> None:
    path = bags.write(tmp_path / "bag", Session(storage="sqlite3", distro="humble"))
    with sqlite3.connect(path / "bag.db3") as db:
        db.executescript(
            "DROP TABLE message_definitions; DROP TABLE schema; DROP TABLE metadata;"
            "CREATE TABLE t (id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT, offered_qos_profiles TEXT);"
            "INSERT INTO t SELECT id, name, type, serialization_format, offered_qos_profiles FROM topics;"
            "DROP TABLE topics; ALTER TABLE t RENAME TO topics;"
        )
    check(path)


def test_what_is_still_in_sqlite_s_journal_is_read_too(tmp_path: Path) -> None:
    path = bags.write(tmp_path / "bag", Session(storage="sqlite3"))
    (path / "metadata.yaml").unlink()
    db = sqlite3.connect(path / "bag.db3", isolation_level=None)
    db.execute("PRAGMA journal_mode=WAL")
    db.execute("PRAGMA wal_autocheckpoint=0")
    db.execute("UPDATE messages SET timestamp = timestamp + 1")  # now every message's row is in the -wal file alone
    killed = tmp_path / "killed"
    shutil.copytree(path, killed)
    db.close()
    assert (killed / "bag.db3-wal").stat().st_size > 1000
    before = (killed / "bag.db3").read_bytes()
    check(killed)
    assert (killed / "bag.db3").read_bytes() == before  # SQLite repaired a copy, not the original
    with open_bag(killed, cell_frame="cell") as reader:
        first = next(m for m in reader.messages() if m.topic.endswith("image"))
        assert (first.log_ns - first.stamp_ns) == 1


def test_a_big_endian_recorder_s_stamps_order_the_bag(tmp_path: Path) -> None:
    from tof_core.bag_index import _stamp_at

    raw = bytes([0, 0, 0, 0]) + (12).to_bytes(4, "big") + (34).to_bytes(4, "big")
    assert _stamp_at(raw, 4) == 12_000_000_034
    raw = bytes([0, 1, 0, 0]) + (12).to_bytes(4, "little") + (34).to_bytes(4, "little")
    assert _stamp_at(raw, 4) == 12_000_000_034
    assert _stamp_at(b"\0\1", 4) == 0
