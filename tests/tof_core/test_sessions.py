# SPDX-License-Identifier: Apache-2.0
"""A bag whose clock was set back has sessions; one of them is read, with its own TF, and the reader says so."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from tof_core import se3
from tof_core.bag import open_bag
from tof_core.bag_writer import BagWriter
from tof_core.camera import Camera
from tof_core.errors import BagError
from tof_core.jump import JUMP_NS
from tof_core.options import BagOptions
from tof_core.sessions import session_starts, set_back

if TYPE_CHECKING:
    from pathlib import Path

CAMERA = Camera(16, 12, 15.0, 15.0, 7.5, 5.5, frame_id="hand_depth_sensor")
START, FRAME = 1_700_000_000_000_000_000, 66_000_000


class Logged(BagWriter):
    """Logs messages at another time than they are stamped."""

    log_ns = 0

    def raw(self, topic: str, type_name: str, cdr: bytes, stamp_ns: int) -> None:
        """As the writer's, at `log_ns`."""
        super().raw(topic, type_name, cdr, self.log_ns or stamp_ns)


def looped(path: Path, sizes: tuple[int, ...]) -> Path:
    """A bag of sessions that all begin at the same stamp, each logged after the other; session k stands k metres further."""
    log = START
    with Logged(path) as bag:
        for number, size in enumerate(sizes):
            for k in range(size):
                log, at = log + FRAME, START + k * FRAME
                bag.log_ns = log
                bag.tf(at, [("cell", CAMERA.frame_id, se3.exp([number, 0, 0, 0, 0, 0]))])
                bag.camera_info("/depth/hand/camera_info", CAMERA, at)
                counts = np.full(CAMERA.shape, 800 + number * 50 + k % 9, np.uint16)
                bag.image("/depth/hand/image", counts, "16UC1", CAMERA.frame_id, at)
    return path


def test_the_longest_session_is_read_with_its_own_tf_and_the_note_says_so(tmp_path: Path) -> None:
    with open_bag(looped(tmp_path / "bag", (30, 50, 20))) as reader:
        captures = list(reader.captures())
        assert reader.frame_count == 50
        assert "the clock was set back: 3 sessions (images, clouds and CameraInfos: 60, 100, 40); session 2 is read" in reader.note
    assert len(captures) >= 48
    assert {round(float(c.robot.T_cell_camera[0, 3]), 6) for c in captures if c.robot} == {1.0}
    assert {int(np.median(c.depth) * 1000 + 0.5) // 50 for c in captures} == {17}
    assert [c.stamp_ns for c in captures] == sorted(c.stamp_ns for c in captures)


@pytest.mark.parametrize(("session", "frames"), [(1, 30), (2, 50), (3, 20)])
def test_each_session_can_be_read(session: int, frames: int, tmp_path: Path) -> None:
    with open_bag(looped(tmp_path / "bag", (30, 50, 20)), BagOptions(session=session)) as reader:
        assert reader.frame_count == frames
        assert {round(float(c.robot.T_cell_camera[0, 3]), 6) for c in reader.captures() if c.robot} == {session - 1.0}


def test_a_session_that_is_not_there_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BagError, match=r"has 3 sessions, no session 4; --session 1 to 3"):
        open_bag(looped(tmp_path / "bag", (20, 20, 20)), BagOptions(session=4))


def test_a_bag_of_one_session_has_no_note(tmp_path: Path) -> None:
    with open_bag(looped(tmp_path / "bag", (12,))) as reader:
        assert reader.note == ""
        assert reader.frame_count == 12


def test_late_messages_are_no_jump_and_three_ascending_ones_far_back_are() -> None:
    stamps = np.arange(20) * FRAME + START
    delayed = stamps.copy()
    delayed[[5, 12]] = stamps[[3, 10]]
    assert set_back(delayed) == []
    back = np.concatenate([stamps + 2 * JUMP_NS, stamps, stamps])
    assert set_back(back) == [20, 40]


def test_bad_stamps_of_one_topic_do_not_split_the_session() -> None:
    good, bad = np.arange(40) * FRAME + START, np.tile(np.arange(20) * FRAME, 2) + START
    topics = np.tile([0, 1, 2], 40)
    stamps = np.stack([good, good, bad], axis=1).ravel()
    logs = np.repeat(good, 3)
    assert session_starts(topics, stamps, logs, {0, 1, 2}) == []
    assert session_starts(topics, stamps, logs, {2}) == [int(good[20])]
