# SPDX-License-Identifier: Apache-2.0
"""Captures from live messages: independent of their order, and waiting only for messages that may still arrive."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from tests.tof_core import bags
from tests.tof_core.bags import CAMERA, FRAME, Session, stamp
from tof_core.bag import BagOptions, open_bag
from tof_core.builder import CaptureBuilder
from tof_core.robot import RobotChain
from tof_core.tf import TransformBuffer
from tof_core.topics import TF

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

    from tof_core.capture import Capture

SESSION = Session(frames=12, tf_to=1.2)


class Live:
    """A node's way of building captures: TF and topics come in as they are fed."""

    def __init__(self, path: Path, **more: Any) -> None:
        with open_bag(path, cell_frame="cell") as reader:
            self.messages = [(m, reader.deserialize(m)) for m in reader.messages()]
            self.topics = reader.topics
            self.offline = list(reader.captures())
        self.transforms = TransformBuffer(0.2)
        self.builder = CaptureBuilder(BagOptions(), RobotChain(self.transforms, "cell"), self.topics, **more)

    def feed(self, messages: Iterable[tuple[Any, Any]]) -> list[Capture]:
        b, t = self.builder, self.topics
        takes = {t.depth: b.depth, t.info: b.info, t.amplitude: b.amplitude, t.temperature: b.temperature}
        out: list[Capture] = []
        for raw, msg in messages:
            if raw.type == TF:
                self.transforms.add_message(msg, static=raw.topic.endswith("static"))
            else:
                takes[raw.topic](msg)
            out += b.ready()
        return out


@pytest.fixture
def live(tmp_path: Path) -> Live:
    return Live(bags.write(tmp_path / "bag", SESSION))


def same(a: list[Capture], b: list[Capture]) -> None:
    assert [c.stamp_ns for c in a] == [c.stamp_ns for c in b]
    for x, y in zip(a, b, strict=True):
        np.testing.assert_array_equal(x.depth, y.depth)
        np.testing.assert_array_equal(x.amplitude, y.amplitude)
        assert x.robot is not None
        assert y.robot is not None
        np.testing.assert_array_equal(x.robot.T_cell_camera, y.robot.T_cell_camera)


def test_live_gives_what_offline_gave(live: Live) -> None:
    same(live.feed(live.messages), live.offline)


@pytest.mark.parametrize("seed", range(5))
def test_messages_a_little_out_of_order_change_nothing(live: Live, seed: int) -> None:
    random = np.random.default_rng(seed)
    keys = [0 if m.topic == "/tf_static" else m.stamp_ns + int(random.integers(0, FRAME // 2)) for m, _ in live.messages]
    shuffled = [live.messages[i] for i in np.argsort(keys, kind="stable")]
    seen = live.feed(shuffled)
    seen += list(live.builder.ready(final=True))
    same(seen, live.offline)


def only(live: Live, *topics: str) -> list[tuple[Any, Any]]:
    return [m for m in live.messages if m[0].topic in topics]


def test_a_frame_waits_for_tf_and_is_given_out_once_it_came(live: Live) -> None:
    t = live.topics
    assert live.feed(only(live, t.info, t.amplitude, t.temperature, t.depth)[:16]) == []
    assert live.builder.waiting
    seen = live.feed(only(live, "/tf", "/tf_static"))
    assert [c.stamp_ns for c in seen] == [stamp(i) for i in range(len(seen))]
    assert len(seen) >= 3


def test_tf_that_had_no_answer_is_asked_again_only_once_it_has_changed(live: Live, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[int] = []
    check = RobotChain.check

    def counted(chain: RobotChain, camera: str, stamp_ns: int) -> None:
        asked.append(stamp_ns)
        check(chain, camera, stamp_ns)

    monkeypatch.setattr(RobotChain, "check", counted)
    live.feed([m for m in live.messages if m[0].type != TF])
    assert asked
    first = len(asked)
    assert [*live.builder.ready(), *live.builder.ready()] == []
    assert len(asked) == first
    live.feed([m for m in live.messages if m[0].type == TF])
    assert len(asked) > first


def test_without_tf_frames_are_skipped_after_a_while_and_counted(live: Live) -> None:
    t = live.topics
    told: list[tuple[int, str]] = []
    live.builder.on_skip = lambda at, why: told.append((at, why))
    assert live.feed(only(live, t.info, t.amplitude, t.depth)) == []
    assert list(live.builder.ready(final=True)) == []
    assert live.builder.skipped == Counter({"no transform": 12})
    assert told == [(stamp(i), "no transform") for i in range(12)]
    assert "no transform has come on /tf or /tf_static" in live.builder.last_error


def test_without_camera_info_no_capture_is_emitted(live: Live) -> None:
    t = live.topics
    assert live.feed(only(live, "/tf_static", "/tf", t.amplitude, t.depth)) == []
    assert list(live.builder.ready(final=True)) == []
    assert live.builder.skipped == Counter({"no camera_info": 12})


def test_a_dead_amplitude_stream_holds_frames_up_only_for_a_while(live: Live) -> None:
    t = live.topics
    seen = live.feed(only(live, "/tf_static", "/tf", t.info, t.depth))
    assert len(seen) == 4  # those older than half a second of depth stamps
    assert all(c.amplitude is None for c in seen)


def test_an_endless_wait_is_ended_by_the_node(tmp_path: Path) -> None:
    live = Live(bags.write(tmp_path / "bag", SESSION), wait_s=float("inf"))
    t = live.topics
    assert live.feed(only(live, "/tf_static", "/tf", t.info, t.depth)) == []
    live.builder.overdue = stamp(5)
    assert [c.stamp_ns for c in live.builder.ready()] == [stamp(i) for i in range(6)]


def test_a_late_frame_is_counted_not_given_out_of_order(live: Live) -> None:
    seen = live.feed(live.messages)
    first = next(msg for raw, msg in live.messages if raw.topic == live.topics.depth)
    live.builder.depth(first)
    assert list(live.builder.ready(final=True)) == []
    assert live.builder.skipped == Counter({"late": 1})
    assert len(seen) == 12


def test_a_reset_takes_the_same_frames_again(live: Live) -> None:
    first = live.feed(live.messages)
    live.builder.reset()
    live.transforms.clear_dynamic()
    same(live.feed(live.messages), first)


def test_the_same_camera_info_gives_the_same_rays(live: Live) -> None:
    seen = live.feed(live.messages)
    assert seen[0].camera == CAMERA
    assert seen[0].camera.rays() is seen[-1].camera.rays()
