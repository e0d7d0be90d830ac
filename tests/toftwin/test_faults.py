# SPDX-License-Identifier: Apache-2.0
"""What goes wrong on a robot, in the running graph: it goes on, says what happened, and keeps what was recorded."""

from __future__ import annotations

import time
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from tests.tof_ros.peers import wait_for
from tests.toftwin.faulty_robot import CAMERA, FaultyRobot
from tof_core.camera import Camera

pytest.importorskip("rclpy", reason="no ROS 2 here")

if TYPE_CHECKING:
    from collections.abc import Iterator

pytestmark = pytest.mark.dds
HOUR_NS = 3_600_000_000_000


class Graph:
    """`preproc` and `sim_label`, each in a thread, and their robot."""

    def __init__(self, context: Any, namespace: str = "spot") -> None:
        from tof_preproc.node import make_node as make_preproc
        from tof_ros.environment import parameter_overrides
        from tof_sim_label.node import make_node as make_label

        live = {"live.reliable": True, "live.patience_s": 0.5}
        label = {"live.scene": "body_section", "live.settle_s": 0.0, "live.patience_s": 0.5}
        self.nodes: list[Any] = [
            make_preproc(context=context, namespace=namespace, parameter_overrides=parameter_overrides(live)),
            make_label(context=context, namespace=namespace, parameter_overrides=parameter_overrides(label)),
        ]
        self.at = 0

    def begin(self, frames: int = 100) -> int:
        """A number from which on frames are new: each test has its own stretch of time."""
        self.at += frames
        return self.at - frames


@pytest.fixture(scope="module")
def context(ros_domain: int) -> Iterator[Any]:
    from tof_ros.environment import ros_context

    with ros_context(domain=ros_domain) as context:
        yield context


@pytest.fixture(scope="module")
def running(context: Any) -> Iterator[tuple[Graph, FaultyRobot]]:
    from tof_ros.spin import spinning

    graph, robot = Graph(context), FaultyRobot(context)
    with spinning([*graph.nodes, robot.node]):
        wait_for(lambda: graph.nodes[1].active)
        robot.connect()
        yield graph, robot


def test_lost_messages_lose_only_their_own_frames(running: tuple[Graph, FaultyRobot]) -> None:
    graph, robot = running
    n = graph.begin()
    robot.tf(n, n + 12)
    sent = [robot.frame(n + k, info=k % 4 == 0) for k in range(12) if k % 3]
    assert robot.fates(sent) == {"kept": 8}
    assert robot.fates(sent, "label") == {"kept": 8}


def test_doubled_messages_count_once(running: tuple[Graph, FaultyRobot]) -> None:
    graph, robot = running
    n = graph.begin()
    sent = robot.frames(range(n, n + 6), twice=True)
    wait_for(lambda: robot.fates(sent).total() == 12)
    assert robot.fates(sent) == {"kept": 6, "frozen": 6}
    assert robot.fates(sent, "label") == {"kept": 6}


def test_doubled_frames_that_wait_in_vain_have_their_end(running: tuple[Graph, FaultyRobot]) -> None:
    graph, robot = running
    n = graph.begin()
    sent = [robot.frame(n + k, twice=True) for k in range(3)]
    wait_for(lambda: robot.fates(sent).total() == 6, what="for the first of each")
    assert robot.fates(sent) == {"frozen": 3, "no transform": 3}


def test_reordered_messages_come_out_in_order_and_none_is_unaccounted(running: tuple[Graph, FaultyRobot]) -> None:
    graph, robot = running
    n = graph.begin()
    robot.tf(n, n + 8)
    sent = [robot.frame(n + k) for k in (1, 0, 3, 2, 5, 4, 7, 6)]
    fates = robot.fates(sent)
    assert fates.total() == 8
    assert set(fates) <= {"kept", "late"}
    assert fates["kept"] >= 4
    kept = [stamp for stamp, fate in robot.done["preproc"] if fate == "kept" and stamp in sent]
    assert all(a < b for a, b in pairwise(kept))


def test_frames_delayed_by_two_seconds_are_kept(running: tuple[Graph, FaultyRobot]) -> None:
    graph, robot = running
    n = graph.begin()
    robot.tf(n, n + 31)  # TF is on time, two seconds ahead of the images
    time.sleep(1.0)
    sent = [robot.frame(n + k) for k in range(4)]
    assert robot.fates(sent) == {"kept": 4}
    assert robot.fates(sent, "label") == {"kept": 4}


def test_a_frame_stamped_in_the_future_is_reported_and_the_graph_recovers(running: tuple[Graph, FaultyRobot]) -> None:
    graph, robot = running
    n = graph.begin()
    robot.frames(range(n, n + 3))
    future = robot.frame(n + 3, shift_ns=HOUR_NS)
    assert robot.fates([future]) == {"no transform": 1}
    late = robot.frames(range(n + 4, n + 7))
    assert robot.fates(late) == {"late": 3}
    after = robot.frames(range(n + 7, n + 10))
    assert robot.fates(after) == {"kept": 3}
    assert robot.fates(after, "label") == {"kept": 3}


def test_tf_from_the_future_or_of_another_robots_clock_costs_no_frame(running: tuple[Graph, FaultyRobot]) -> None:
    """A frame comes before its transforms, as it does live: it must go on waiting for them."""
    graph, robot = running
    n = graph.begin()
    robot.stray_tf(n, HOUR_NS)
    for k in range(3):
        robot.stray_tf(n + k, HOUR_NS, child="other_robot")
    sent = []
    for k in range(6):
        sent.append(robot.frame(n + k))
        time.sleep(0.15)
        robot.tf(n + k, n + k)
    assert robot.fates(sent) == {"kept": 6}
    assert robot.fates(sent, "label") == {"kept": 6}
    for node in ("preproc", "sim_label"):
        assert robot.observer.trigger(f"/spot/{node}/reset").success


def test_a_clock_set_back_begins_afresh_in_every_node(running: tuple[Graph, FaultyRobot]) -> None:
    graph, robot = running
    n = graph.begin()
    assert robot.fates(robot.frames(range(n, n + 3)), "label") == {"kept": 3}
    back = -HOUR_NS // 60
    robot.fates(robot.frames(range(n + 4, n + 7), shift_ns=back))
    after = robot.paced(range(n + 7, n + 14), shift_ns=back)
    assert robot.fates(after) == {"kept": 7}
    fates = robot.fates(after, "label")
    assert fates["late"] <= 3
    assert fates["kept"] == 7 - fates["late"] >= 4
    wait_for(lambda: sum("set back: starting afresh" in line for line in robot.observer.log) >= 2)
    graph.begin(HOUR_NS // 60 // 66_000_000)  # on from here


def test_frames_without_tf_are_skipped_and_reported_until_tf_returns(running: tuple[Graph, FaultyRobot]) -> None:
    graph, robot = running
    n = graph.begin()
    assert robot.fates(robot.frames(range(n, n + 3))) == {"kept": 3}
    without = [robot.frame(n + 10 + k) for k in range(3)]
    assert robot.fates(without) == {"no transform": 3}
    robot.observer.status("spot/preproc", lambda s: "frames skipped" in s.message and "no transform" in s.message)
    after = robot.frames(range(n + 20, n + 23))
    assert robot.fates(after) == {"kept": 3}
    assert robot.fates(after, "label") == {"kept": 3}


def test_a_camera_that_changes_its_size_begins_a_new_dwell(running: tuple[Graph, FaultyRobot]) -> None:
    graph, robot = running
    n = graph.begin()
    other = Camera(32, 24, 30.0, 30.0, 15.5, 11.5, frame_id=CAMERA.frame_id)
    assert robot.fates(robot.frames(range(n, n + 3))) == {"kept": 3}
    changed = robot.frames(range(n + 10, n + 13), camera=other)
    assert robot.fates(changed) == {"kept": 3}
    assert robot.fates(changed, "label").total() == 3
    back = robot.frames(range(n + 20, n + 23))
    assert robot.fates(back) == {"kept": 3}
    assert robot.fates(back, "label") == {"kept": 3}


def test_an_image_of_another_size_than_its_camera_info_is_a_bad_frame(running: tuple[Graph, FaultyRobot]) -> None:
    graph, robot = running
    n = graph.begin()
    other = Camera(32, 24, 30.0, 30.0, 15.5, 11.5, frame_id=CAMERA.frame_id)
    good = robot.frames(range(n, n + 2))
    bad = robot.frames(range(n + 2, n + 4), camera=other, info=False)
    assert robot.fates([*good, *bad]) == {"kept": 2, "bad camera": 2}
    assert robot.fates(robot.frames(range(n + 4, n + 6))) == {"kept": 2}


def test_a_subscriber_that_never_reads_delays_no_other(context: Any, running: tuple[Graph, FaultyRobot]) -> None:
    import rclpy
    from sensor_msgs.msg import Image

    from tof_ros import qos

    graph, robot = running
    n = graph.begin()
    deaf = rclpy.create_node("deaf", context=context)
    for name in ("depth", "sigma", "count", "reason"):
        deaf.create_subscription(Image, f"/spot/preproc/{name}", lambda _: None, qos.OUTPUT)
    wait_for(lambda: robot.node.count_subscribers("/spot/preproc/depth") == 2)
    for k in range(0, 60, 10):
        sent = robot.frames(range(n + k, n + k + 10))
        assert robot.fates(sent) == {"kept": 10}
        assert robot.fates(sent, "label") == {"kept": 10}
    deaf.destroy_node()


def test_a_camera_that_leaves_and_a_label_node_that_restarts_find_the_graph_again(context: Any, running: tuple[Graph, FaultyRobot]) -> None:
    from tof_ros.spin import spinning
    from tof_ros.views import DWELL

    graph, robot = running
    n = graph.begin()
    label = graph.nodes[1]
    label.trigger_deactivate()
    label.trigger_cleanup()
    assert robot.fates(robot.frames(range(n, n + 3))) == {"kept": 3}
    robot.node.destroy_publisher(robot._image)
    wait_for(lambda: robot.node.count_publishers("/spot/depth/hand/image") == 0)
    other = FaultyRobot(context, name="robot_again")
    with spinning([other.node]):
        label.trigger_configure()
        label.trigger_activate()
        wait_for(lambda: other.node.count_subscribers(f"/spot/preproc/{DWELL}") == 1)
        other.connect()
        sent = other.frames(range(n + 10, n + 14))
        assert other.fates(sent) == {"kept": 4}
        assert other.fates(sent, "label") == {"kept": 4}


def test_two_robots_in_one_domain_see_their_own(context: Any) -> None:
    from sensor_msgs.msg import Image

    from tof_core.decode import pixels
    from tof_preproc.node import make_node
    from tof_ros import qos
    from tof_ros.environment import parameter_overrides
    from tof_ros.spin import spinning

    values = parameter_overrides({"live.reliable": True})
    nodes = [make_node(context=context, namespace=name, parameter_overrides=values) for name in ("alpha", "beta")]
    robots = {name: FaultyRobot(context, name, f"robot_{name}", metres=m) for name, m in (("alpha", 0.7), ("beta", 1.4))}
    heard: dict[str, list[float]] = {name: [] for name in robots}
    frames: dict[str, set[str]] = {name: set() for name in robots}
    for name, robot in robots.items():

        def take(message: Any, name: str = name) -> None:
            heard[name].append(float(np.nanmedian(pixels(message))))
            frames[name].add(message.header.frame_id)

        robot.node.create_subscription(Image, f"/{name}/preproc/depth", take, qos.OUTPUT)
    with spinning([*nodes, *(r.node for r in robots.values())]):
        for robot in robots.values():
            robot.connect()
        sent = {name: robot.frames(range(5000, 5005)) for name, robot in robots.items()}
        assert {name: robot.fates(sent[name]) for name, robot in robots.items()} == {name: {"kept": 5} for name in robots}
        wait_for(lambda: all(len(values) == 5 for values in heard.values()))
        told = {name: robots[name].observer.values(f"{name}/preproc", lambda v: v["kept"] == "5") for name in robots}
    assert {name: round(float(np.median(values)), 2) for name, values in heard.items()} == {"alpha": 0.7, "beta": 1.4}
    assert frames == {name: {f"{name}/hand_depth"} for name in robots}
    assert {name: values["seen"] for name, values in told.items()} == {"alpha": "5", "beta": "5"}
