# SPDX-License-Identifier: Apache-2.0
"""Damaged, unfinished and missing bags: one line of error, and no complete message is lost."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
import pytest

from tests.tof_core import bags
from tests.tof_core.bags import CAMERA, Session, stamp
from tof_core.bag import BagOptions, open_bag
from tof_core.bag_files import open_files
from tof_core.bag_writer import BagWriter
from tof_core.encode import depth_counts
from tof_core.errors import BagError, ToftwinError, UsageError

if TYPE_CHECKING:
    from tof_core.arrays import Image

Storage = Literal["mcap", "sqlite3"]
STORAGES = pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
REPOSITORY = Path(__file__).resolve().parents[2]
MANY = Session(frames=60, amplitude=False, tf_to=4.5)


def stamps(path: Path, options: BagOptions | None = None) -> list[int]:
    with open_bag(path, options, cell_frame="cell") as reader:
        return [c.stamp_ns for c in reader.captures()]


def refusal(path: Path) -> str:
    with pytest.raises(BagError) as caught:
        stamps(path)
    assert "\n" not in str(caught.value)
    assert str(path) in str(caught.value)
    return str(caught.value)


def storage_file(path: Path) -> Path:
    return next(p for p in path.iterdir() if p.suffix in (".mcap", ".db3"))


def test_no_bag_no_folder_and_no_storage_are_distinguished(tmp_path: Path) -> None:
    assert "does not exist" in refusal(tmp_path / "nothing")
    with pytest.raises(UsageError):
        open_bag(tmp_path / "nothing")
    (tmp_path / "empty").mkdir()
    assert "is no bag" in refusal(tmp_path / "empty")
    (tmp_path / "letter.txt").write_text("dear")
    assert "is no bag" in refusal(tmp_path / "letter.txt")


@pytest.mark.parametrize("name", ["fake.mcap", "fake.db3"])
@pytest.mark.parametrize("content", [b"", b"nonsense" * 100])
def test_a_file_that_only_has_the_name_of_a_bag(tmp_path: Path, name: str, content: bytes) -> None:
    (tmp_path / name).write_bytes(content)
    refusal(tmp_path / name)


def test_metadata_that_is_no_yaml_or_lacks_keys(tmp_path: Path) -> None:
    path = bags.write(tmp_path / "bag")
    (path / "metadata.yaml").write_text("{[")
    refusal(path)
    (path / "metadata.yaml").write_text("rosbag2_bagfile_information: {version: 9}")
    refusal(path)


@pytest.mark.parametrize("share", [0.02, 0.3, 0.6, 0.95])
def test_a_truncated_bag_is_refused_and_its_intact_messages_can_be_recovered(tmp_path: Path, share: float) -> None:
    path = bags.write(tmp_path / "bag", MANY)
    file = storage_file(path)
    os.truncate(file, int(file.stat().st_size * share))
    text = refusal(path)
    assert "--recover" in text
    if share > 0.1:
        found = stamps(path, BagOptions(recover=True))
        # Of what is left, the frames whose bytes are whole: TF of 4.7 s comes first in the file, in less than a tenth of it.
        assert found == [stamp(i) for i in range(len(found))]
        assert len(found) >= int(60 * (share - 0.12))


def test_a_truncated_sqlite_bag_is_refused(tmp_path: Path) -> None:
    path = bags.write(tmp_path / "bag", Session(frames=60, storage="sqlite3"))
    file = storage_file(path)
    os.truncate(file, file.stat().st_size // 2)
    refusal(path)


@pytest.mark.parametrize("at", [0.3, 0.5, 0.9])
def test_a_bag_with_flipped_bytes_is_one_line_or_right(tmp_path: Path, at: float) -> None:
    path = bags.write(tmp_path / "bag", MANY)
    file = storage_file(path)
    data = bytearray(file.read_bytes())
    middle = int(len(data) * at)
    data[middle : middle + 64] = bytes(255 - b for b in data[middle : middle + 64])
    file.write_bytes(data)
    said = ""
    found: list[int] = []
    try:
        found = stamps(path)
    except ToftwinError as error:
        said = str(error)
    assert (said == "") == (len(found) == 60)
    assert "\n" not in said


RECORDER = """
import os, signal, sys
from dataclasses import replace
from pathlib import Path
from tests.tof_core import bags
from tof_core.bag_writer import BagWriter
s = bags.Session(storage=sys.argv[2], amplitude=False, tf_to=4.5)
with BagWriter(Path(sys.argv[1]), sys.argv[2]) as bag:
    bags.write_tf(bag, s)
    for i in range(60):
        bags.write_frame(bag, s, i)
        if i == 39:
            bag.flush()
    os.kill(os.getpid(), signal.SIGKILL)
"""


@STORAGES
def test_a_killed_recorder_leaves_every_frame_it_had_flushed(tmp_path: Path, storage: Storage) -> None:
    path = tmp_path / "bag"
    done = subprocess.run([sys.executable, "-c", RECORDER, str(path), storage], cwd=REPOSITORY, check=False)
    assert done.returncode == -signal.SIGKILL
    assert not (path / "metadata.yaml").exists()
    with open_bag(path, cell_frame="cell") as reader:
        found = [c.stamp_ns for c in reader.captures()]
        assert "not finished" in reader.note
    assert len(found) >= 40
    assert found == [stamp(i) for i in range(len(found))]


def test_an_unfinished_file_alone_is_read_too(tmp_path: Path) -> None:
    path = bags.write(tmp_path / "bag", MANY)
    file = storage_file(path)
    os.truncate(file, file.stat().st_size - 4000)
    found = stamps(file)
    assert len(found) > 40
    assert found == [stamp(i) for i in range(len(found))]


def test_a_topic_that_a_recording_gains_while_it_is_read_is_left_out(tmp_path: Path) -> None:
    few, more = (
        storage_file(bags.write(tmp_path / name, replace(MANY, amplitude=amplitude)))
        for name, amplitude in (("few", False), ("more", True))
    )
    for file in (few, more):
        os.truncate(file, file.stat().st_size - 4000)  # A recorder that still writes has written no end.
    opened = open_files(few)
    known = set(opened.topics)
    shutil.copyfile(more, few)
    assert set(open_files(few).topics) > known
    assert {topic for topic, _, _ in opened.messages()} == known


@pytest.mark.parametrize("compression", ["zstd", ""])
def test_an_unfinished_recording_in_chunks_of_a_recorder_is_read_to_its_last_whole_chunk(tmp_path: Path, compression: str) -> None:
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.rosbag2.enums import CompressionFormat, CompressionMode

    path = bags.write(tmp_path / "whole", MANY)
    with open_bag(path) as reader:
        messages = list(reader.messages())
        writer = Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP)
        if compression:
            writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
        writer.open()
        types = {m.topic: m.type for m in messages}
        topics = {name: writer.add_connection(name, kind, typestore=reader._files.types) for name, kind in types.items()}
        for n, m in enumerate(messages):
            writer.write(topics[m.topic], m.log_ns, m.cdr)
            if n % 40 == 39:
                writer.storage.close_chunk()  # type: ignore[union-attr]
        writer.abort()
    found = stamps(tmp_path / "bag")
    assert len(found) > 50
    assert found == [stamp(i) for i in range(len(found))]


FULL_DISK = """
import resource, signal, sys
from dataclasses import replace
from pathlib import Path
from tests.tof_core import bags
from tof_core.bag_writer import BagWriter
from tof_core.errors import BagError
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[3]), int(sys.argv[3])))
s = bags.Session(storage=sys.argv[2], amplitude=False, tf_to=4.5)
try:
    with BagWriter(Path(sys.argv[1]), sys.argv[2]) as bag:
        bags.write_tf(bag, s)
        for i in range(2000):
            bags.write_frame(bag, s, i)
except BagError as error:
    print(error)
    sys.exit(error.exit_code)
"""


@STORAGES
def test_a_full_disk_is_one_line_and_what_was_written_stays(tmp_path: Path, storage: Storage) -> None:
    path = tmp_path / "bag"
    done = subprocess.run(
        [sys.executable, "-c", FULL_DISK, str(path), storage, "1500000"], cwd=REPOSITORY, check=False, capture_output=True, text=True
    )
    assert done.returncode == 1, done.stderr
    assert done.stdout.count("\n") == 1
    assert f"{path}: cannot be written further" in done.stdout
    found = stamps(path)
    assert len(found) > 40
    assert found == [stamp(i) for i in range(len(found))]


def test_an_error_in_the_recording_program_leaves_a_finished_bag(tmp_path: Path) -> None:
    def record() -> None:
        with BagWriter(tmp_path / "bag") as bag:
            bags.write_tf(bag, Session())
            for i in range(5):
                bags.write_frame(bag, Session(), i)
            raise RuntimeError("the arm fell off")

    with pytest.raises(RuntimeError, match="the arm"):
        record()
    assert (tmp_path / "bag" / "metadata.yaml").exists()
    assert stamps(tmp_path / "bag") == [stamp(i) for i in range(5)]


def test_a_bag_is_never_overwritten(tmp_path: Path) -> None:
    path = bags.write(tmp_path / "bag")
    with pytest.raises(BagError, match="exists already"), BagWriter(path):
        pass
    assert len(stamps(path)) == 6


def test_wrong_words_are_usage_errors(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="storage 'rosbag1' is not known"):
        BagWriter(tmp_path / "bag", "rosbag1")  # type: ignore[arg-type]
    with pytest.raises(UsageError, match="distribution 'kilted' is not known"):
        BagWriter(tmp_path / "bag", "mcap", "kilted")  # type: ignore[arg-type]


def test_writing_outside_of_with_is_refused(tmp_path: Path) -> None:
    bag = BagWriter(tmp_path / "bag")
    depth: Image = np.ones(CAMERA.shape, np.float32)
    with pytest.raises(BagError, match="with statement"):
        bag.image("/depth", depth_counts(depth), "16UC1", "camera", 0)
    assert not (tmp_path / "bag").exists()


def test_a_bag_without_any_message_is_one_line(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag"):
        pass
    assert "has no depth image" in refusal(tmp_path / "bag")


def test_a_transform_that_is_no_motion_is_a_gap_not_the_end(tmp_path: Path) -> None:
    s = Session(tf_gap=(0.09, 0.11))
    with BagWriter(tmp_path / "bag") as bag:
        bags.write_tf(bag, s)
        for i in range(6):
            bags.write_frame(bag, s, i)
        bad = bag._new("geometry_msgs/msg/Transform", **bag._parts(np.eye(4), "translation", "rotation", "Vector3"))
        bad.rotation.w = float("nan")
        header = bag._header(stamp(1) + 1000, "cell")
        edge = bag._new("geometry_msgs/msg/TransformStamped", header=header, child_frame_id="spot/body", transform=bad)
        bag._message("/tf", "tf2_msgs/msg/TFMessage", stamp(1) + 1000, transforms=[edge])
    assert stamps(tmp_path / "bag") == [stamp(i) for i in range(6)]
    with open_bag(tmp_path / "bag") as reader:
        assert reader.note == "1 messages left out: no rigid motion"


def test_with_recover_one_damaged_message_loses_only_itself(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag") as bag:
        bags.write_tf(bag, Session())
        for i in range(6):
            bags.write_frame(bag, Session(), i)
        header = b"\0\1\0\0" + (stamp(5) // bags.SECOND).to_bytes(4, "little") + (stamp(5) % bags.SECOND + 7).to_bytes(4, "little")
        bag.raw("/spot/depth/hand/image", "sensor_msgs/msg/Image", header + b"\xff" * 40, stamp(6))
    assert "topic /spot/depth/hand/image: is damaged" in refusal(tmp_path / "bag")
    with open_bag(tmp_path / "bag", BagOptions(recover=True), cell_frame="cell") as reader:
        assert len(list(reader.captures())) == 6
        assert reader.skipped == {"damaged": 1}
