# SPDX-License-Identifier: Apache-2.0
"""A node that is killed, and a disk that is full, while a recording runs: what was recorded is there, and the graph goes on."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from tests.tof_ros.peers import wait_for
from tests.toftwin.faulty_robot import FaultyRobot
from tof_core.bag import open_bag
from tof_core.camera import Camera
from tof_core.errors import ToftwinError
from tof_core.options import BagOptions
from toftwin.graph import GraphSpec, graph_process

pytest.importorskip("rclpy", reason="no ROS 2 here")

if TYPE_CHECKING:
    from collections.abc import Iterator

pytestmark = pytest.mark.dds


@pytest.fixture
def robot(ros_domain: int) -> Iterator[FaultyRobot]:
    from tof_ros.environment import ros_context
    from tof_ros.spin import spinning

    with ros_context(domain=ros_domain) as context:
        robot = FaultyRobot(context, metres=0.9)
        with spinning([robot.node]):
            yield robot


def spec(folder: Path) -> GraphSpec:
    return GraphSpec(("preproc",), {"preproc": {"live.reliable": True, "live.record": str(folder)}}, namespace="spot")


def recording(robot: FaultyRobot) -> Path:
    """Start one; gives its folder once the recorder hears the robot."""
    before = robot.node.count_subscribers("/spot/depth/hand/image")
    answer = robot.observer.trigger("/spot/preproc/start_recording")
    assert answer.success, answer.message
    wait_for(lambda: robot.node.count_subscribers("/spot/depth/hand/image") > before)
    time.sleep(0.3)
    return Path(answer.message.removeprefix("recording to "))


def recorded(bag: Path) -> list[int]:
    """Stamps of the frames in a bag, finished or not."""
    with open_bag(bag, BagOptions(recover=True)) as reader:
        return [m.stamp_ns for m in reader.messages((reader.topics.depth,))]


def on_disk(bag: Path) -> list[int]:
    """The same of a bag that may not have a readable frame yet."""
    with suppress(ToftwinError):
        return recorded(bag)
    return []


def test_a_node_killed_while_recording_loses_no_recorded_frame_and_its_successor_goes_on(
    ros_domain: int, robot: FaultyRobot, tmp_path: Path
) -> None:
    with graph_process(spec(tmp_path), ros_domain) as graph:
        robot.connect()
        bag = recording(robot)
        sent = robot.frames(range(10))
        assert robot.fates(sent) == {"kept": 10}
        wait_for(lambda: on_disk(bag) == sent)  # what is not on the disk yet may be lost
        graph.process.kill()
        assert graph.process.wait(10) == -9
    assert recorded(bag) == sent
    with graph_process(spec(tmp_path), ros_domain):
        numbers = iter(range(20, 1000))
        wait_for(lambda: robot.paced([next(numbers)]) and robot.done["preproc"][-1][0] > sent[-1])
        assert robot.fates(robot.frames([next(numbers) for _ in range(4)])) == {"kept": 4}


LIMITED = "import resource, sys; resource.setrlimit(resource.RLIMIT_FSIZE, (3_000_000,) * 2); from toftwin.cli import main; sys.exit(main(sys.argv[1:]))"


@contextmanager
def small_disk(spec: GraphSpec, domain: int) -> Iterator[Any]:
    """The graph on a disk that takes three megabytes a file."""
    environment = {**os.environ, "ROS_DOMAIN_ID": str(domain)}
    process = subprocess.Popen([sys.executable, "-c", LIMITED, *spec.command()[3:]], env=environment)
    try:
        yield process
    finally:
        process.terminate()
        process.wait(10)


LARGE = Camera(640, 480, 600.0, 600.0, 319.5, 239.5, frame_id="hand_depth")
"""An image of it is larger than the half megabyte that Fast DDS shares with other processes unless told otherwise."""


def test_a_large_image_does_not_push_out_the_camera_info_before_it(ros_domain: int, robot: FaultyRobot, tmp_path: Path) -> None:
    with graph_process(spec(tmp_path), ros_domain):
        robot.connect()
        assert robot.fates(robot.paced(range(8), camera=LARGE)) == {"kept": 8}


def test_a_full_disk_ends_the_recording_and_not_the_node(ros_domain: int, robot: FaultyRobot, tmp_path: Path) -> None:
    with small_disk(spec(tmp_path), ros_domain) as process:
        robot.connect()
        bag = recording(robot)
        sent = robot.paced(range(8), camera=LARGE)
        assert robot.fates(sent) == {"kept": 8}
        told = robot.observer.status("spot/preproc", lambda s: "recording stopped" in s.message)
        assert "cannot be written further" in told.message
        refused = robot.observer.trigger("/spot/preproc/stop_recording")
        assert (refused.success, "free some space" in refused.message) == (False, True)
        after = robot.frames(range(10, 13), camera=LARGE)
        assert robot.fates(after) == {"kept": 3}
        assert process.poll() is None
    kept = recorded(bag)
    assert len(kept) >= 2
    assert kept == sent[: len(kept)]
