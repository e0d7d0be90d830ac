# SPDX-License-Identifier: Apache-2.0
"""Views that a busy node's queue pushes out: counted by the numbers of their messages, with the cause and what to do."""

from __future__ import annotations

from threading import Event
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="no ROS 2 here")
from tests.tof_inspect.made import plate, seen
from tests.tof_inspect.test_node import written
from tests.tof_ros.peers import Observer, values, wait_for
from tests.tof_ros.view_source import ViewSource
from tof_ros import overrun, qos
from tof_ros.overrun import Numbered, Overrun

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

QUEUE = qos.OUTPUT.depth


def test_a_number_that_is_left_out_is_a_message_pushed_out() -> None:
    topic = Numbered(lambda: 1)
    assert [topic.take(number, stamp) for number, stamp in ((7, 100), (8, 110), (11, 140))] == [0, 0, 2]
    assert [topic.lacks(stamp) for stamp in (100, 110, 111, 139, 140, 200)] == [False, False, True, True, False, False]


def test_numbers_that_begin_anew_or_are_of_two_publishers_or_unknown_say_nothing() -> None:
    again = Numbered(lambda: 1)
    assert [again.take(number, stamp) for number, stamp in ((500, 1), (1, 2), (2, 3))] == [0, 0, 0]
    two = Numbered(lambda: 2)
    assert [two.take(number, stamp) for number, stamp in ((500, 1), (1, 2), (501, 3))] == [0, 0, 0]
    assert not two.lacks(2)
    unknown = Numbered(lambda: 1)
    assert [unknown.take(None, stamp) for stamp in (1, 2)] == [0, 0]


def test_a_loss_is_a_warning_for_a_while(monkeypatch: pytest.MonkeyPatch) -> None:
    lost = Overrun(30, "Do this.")
    assert lost.warning() == []
    lost.lose(5, 2.4)
    lost.lose(1, 0.0)
    assert lost.warning() == [
        (
            "views come faster than this node takes them: 6 lost in the last 10 s, 6 in all, pushed out of its queue of 30, "
            "in which others waited 2.4 s. Do this."
        )
    ]
    monkeypatch.setattr(overrun, "RECENT_S", 0.0)
    assert lost.warning() == []


class Held:
    """A `sim_label` that is held up in a label until it is let go, and what sends it views."""

    def __init__(self, context: Any, node: Any) -> None:
        self.node, self.observer = node, Observer(context)
        self.source = ViewSource(self.observer.node)
        self.began, self.go = Event(), Event()
        node._work = self._held

    def _held(self, view: Any) -> None:
        del view
        self.began.set()
        assert self.go.wait(60.0)

    def send(self, count: int) -> None:
        """Views, a dwell each."""
        for _ in range(count):
            self.source.send(seen(plate()))


@pytest.fixture
def held(ros_domain: int, tmp_path: Path) -> Iterator[Held]:
    from tof_ros.environment import parameter_overrides, ros_context
    from tof_ros.spin import spinning
    from tof_sim_label.node import make_node

    overrides = {"live.scene": str(written(plate(), tmp_path)), "live.settle_s": 0.0}
    with ros_context(domain=ros_domain) as context:
        node = make_node(context=context, namespace="spot", parameter_overrides=parameter_overrides(overrides))
        bench = Held(context, node)
        with spinning([node, bench.observer.node]):
            wait_for(lambda: node.active and bench.source.matched)
            bench.send(2)  # the second ends the first's dwell
            assert bench.began.wait(30.0)
            yield bench
            bench.go.set()


@pytest.mark.dds
def test_each_view_that_a_busy_node_s_queue_pushes_out_is_counted_and_the_remedy_given(held: Held) -> None:
    held.send(QUEUE + 12)
    held.go.set()
    tally = held.node.tally
    wait_for(lambda: tally.kept == 2 + QUEUE, what=f"{tally.kept} {tally.skipped}")
    assert (tally.seen, dict(tally.skipped)) == (2 + QUEUE + 12, {"overrun": 12})
    status = held.observer.status("spot/sim_label", lambda s: "12 lost in the last 10 s, 12 in all" in s.message)
    assert status.level == b"\x01"
    assert f"pushed out of its queue of {QUEUE}" in status.message
    assert "--param preproc.live.view_every=0" in status.message
    assert "--param sim_label.live.share=0.1" in status.message
    assert values(status)["skipped.overrun"] == "12"


@pytest.mark.dds
def test_a_view_of_which_one_message_was_pushed_out_is_no_incomplete_one(held: Held) -> None:
    from tof_ros import messages

    held.send(QUEUE)
    held.source._out["sigma"].publish(messages.image(np.zeros((2, 2), np.float32), "32FC1", messages.header(1, "camera")))
    held.go.set()
    tally = held.node.tally
    wait_for(lambda: tally.kept + tally.skipped.total() == 2 + QUEUE, what=f"{tally.kept} {tally.skipped}")
    assert dict(tally.skipped) == {"overrun": 1}


@pytest.mark.dds
def test_a_view_that_lacks_a_topic_which_was_never_sent_names_it(held: Held) -> None:
    publisher = held.source._out.pop("sigma")
    held.source._out["sigma"] = type("Nobody", (), {"publish": lambda *_: None})()
    held.send(1)
    held.source._out["sigma"] = publisher
    held.send(1)
    held.go.set()
    wait_for(held.node.tally.skipped.total, what=str(held.node.tally.kept))
    assert dict(held.node.tally.skipped) == {"incomplete": 1}
    wait_for(lambda: any("no preproc/sigma came with its stamp" in line for line in held.observer.log), what="for the log")
