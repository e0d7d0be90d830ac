# SPDX-License-Identifier: Apache-2.0
"""What became of each frame may be asked at any moment of a long run."""

from __future__ import annotations

import threading
from collections import defaultdict
from typing import Any

import pytest

pytest.importorskip("rclpy", reason="no ROS 2 here")

from benchmarks.looped_camera import LoopedCamera


def test_lost_frames_are_counted_while_others_are_sent() -> None:
    camera = LoopedCamera.__new__(LoopedCamera)
    camera.sent, camera.fates = dict.fromkeys(range(100), 0.0), defaultdict(dict)

    class Busy(dict[int, str]):
        """Another frame is sent whenever one is looked up."""

        def get(self, stamp: int, default: Any = None) -> Any:
            camera.sent[len(camera.sent)] = 0.0
            return super().get(stamp, default)

    camera.fates["infer"] = Busy({stamp: "no transform" if stamp in (3, 5) else "kept" for stamp in range(99)})
    assert camera.lost("infer") == 3
    assert len(camera.sent) == 200


def test_a_frame_that_is_part_of_a_later_view_is_not_lost() -> None:
    from sensor_msgs.msg import TimeReference
    from std_msgs.msg import Header

    from tof_ros.messages import to_stamp

    camera = LoopedCamera.__new__(LoopedCamera)
    camera.sent, camera.fates = dict.fromkeys((1, 2, 3), 0.0), defaultdict(dict)
    for stamp, fate in ((1, "accumulated"), (2, "kept"), (3, "no transform")):
        camera._answered("camera0/preproc", TimeReference(header=Header(stamp=to_stamp(stamp)), source=fate))
    camera._answered("camera0/label", TimeReference(header=Header(stamp=to_stamp(2)), source="kept"))
    assert (camera.lost("camera0/preproc"), camera.lost("camera0/label"), camera.lost("label")) == (1, 1, 3)


def test_stamps_of_a_second_play_follow_those_of_the_first(monkeypatch: pytest.MonkeyPatch) -> None:
    camera = LoopedCamera.__new__(LoopedCamera)
    ahead_ns = 2**62
    stamps: list[int] = []
    camera.sent, camera.paced, camera._speed, camera._first, camera._loop_ns, camera._newest_ns = {}, True, 1.0, 0, 1, ahead_ns
    camera.fates, camera.rooms = defaultdict(dict), ("infer",)
    camera._events, camera._frames_topic, camera._stop = [(0, "frame", None)], "frame", threading.Event()

    def send(_topic: str, _message: object, stamp_ns: int) -> None:
        stamps.append(stamp_ns)
        camera.stop()

    monkeypatch.setattr(camera, "_send", send)
    camera.play(1.0)
    assert stamps[0] > ahead_ns
