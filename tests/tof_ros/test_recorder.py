# SPDX-License-Identifier: Apache-2.0
"""A recording is whole when the topics of each room have carried as many messages."""

from __future__ import annotations

import threading
import time
from collections import Counter
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import MagicMock

import pytest

pytest.importorskip("rclpy", reason="no ROS 2 here: neither sourced nor from pip")

from tof_ros.recorder import Recorder


def recorder(**counts: int) -> Recorder:
    made = object.__new__(Recorder)
    made.counts = Counter({f"/{name.replace('__', '/')}": n for name, n in counts.items()})
    return made


def test_rooms_are_even_each_for_itself() -> None:
    assert recorder().even
    assert recorder(preproc__depth=96, preproc__sigma=96, label__depth=12, label__pose=12).even
    assert not recorder(preproc__depth=95, preproc__sigma=96, label__depth=12).even


class SlowWriter:
    """A writer whose messages take a while; it notes whether it was finished in the middle of one."""

    def __init__(self) -> None:
        self.writing, self.finished, self.broken = False, False, False

    def raw(self, *_: object) -> None:
        self.writing = True
        time.sleep(0.2)
        self.writing = False

    def __exit__(self, *_: object) -> None:
        self.finished, self.broken = True, self.writing


def test_a_bag_is_not_finished_in_the_middle_of_a_message(monkeypatch: pytest.MonkeyPatch) -> None:
    slow = SlowWriter()
    monkeypatch.setattr("tof_core.bag_writer.BagWriter", lambda _: SimpleNamespace(__enter__=lambda: slow))
    made = Recorder(MagicMock(), Path("bag"), [])
    arriving = threading.Thread(target=made._write, args=("/depth", "sensor_msgs/msg/Image", b""))
    arriving.start()
    while not slow.writing:
        time.sleep(0.01)
    made.close()
    arriving.join()
    made._write("/depth", "sensor_msgs/msg/Image", b"")  # one that was under way when the subscription ended
    assert slow.finished
    assert not slow.broken
    assert made.counts == {"/depth": 1}
    assert made.failed == ""


@pytest.mark.dds
@pytest.mark.parametrize(
    ("values", "colour"),
    [
        ({}, {"/spot/camera/hand/image", "/spot/camera/hand/camera_info"}),
        ({"input.colour_topic": "/rgb/image/compressed"}, {"/rgb/image/compressed", "/rgb/camera_info"}),
        ({"input.colour_topic": "none"}, set()),
    ],
)
def test_a_recording_of_raw_topics_has_the_colour_camera(ros_domain: int, tmp_path: Path, values: dict[str, str], colour: set[str]) -> None:
    from tof_preproc.node import make_node
    from tof_ros.environment import parameter_overrides, ros_context

    overrides = parameter_overrides({"live.record": str(tmp_path), "live.need_tf": False} | values)
    with ros_context(domain=ros_domain) as context:
        node = make_node(context=context, namespace="spot", parameter_overrides=overrides)
        node._recordings._start()
        recorder = node._recordings._recorder
        assert recorder is not None
        recorded = recorder.topics
        node.destroy_node()
    depth = {"/spot/depth/hand/image", "/spot/depth/hand/camera_info", "/spot/ir/hand/image", "/spot/hand/temperature"}
    assert recorded == depth | colour | {"/tf", "/tf_static"}


@pytest.mark.dds
def test_robots_of_one_cell_record_into_one_folder(ros_domain: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Started in the same second: each bag has its robot's name."""
    from tof_preproc.node import make_node
    from tof_ros.environment import parameter_overrides, ros_context

    monkeypatch.setattr(time, "strftime", lambda _: "20260102_030405")
    overrides = parameter_overrides({"live.record": str(tmp_path), "live.need_tf": False})
    with ros_context(domain=ros_domain) as context:
        nodes = [make_node(context=context, namespace=name, parameter_overrides=overrides) for name in ("alpha", "fleet/beta", "")]
        answers = [node._recordings._start() for node in nodes]
        for node in nodes:
            node.destroy_node()
    names = ["alpha_session_20260102_030405", "fleet_beta_session_20260102_030405", "session_20260102_030405"]
    assert answers == [f"recording to {tmp_path / name}" for name in names]
    assert sorted(path.name for path in tmp_path.iterdir()) == names
