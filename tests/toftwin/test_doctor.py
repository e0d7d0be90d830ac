# SPDX-License-Identifier: Apache-2.0
"""The doctor: a good bag is healthy; each fault is found, named, and comes with what to do."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from benchmarks.radial import z_to_radial
from tof_core import se3
from tof_core.bag_writer import BagWriter
from tof_core.camera import Camera
from tof_core.encode import depth_counts
from tof_core.options import BagOptions
from toftwin import cli
from toftwin.doctor import host
from toftwin.doctor.bag import examine_bag
from toftwin.doctor.finding import Finding, Level, healthy
from toftwin.doctor.live import publishers

if TYPE_CHECKING:
    from pathlib import Path

    from tof_core.arrays import Image

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND
FRAME = 66_666_667
CAMERA = Camera(120, 90, 105.0, 105.0, 59.5, 44.5, frame_id="hand_depth_sensor")
NAMES = {"depth": "/spot/depth/hand/image", "info": "/spot/depth/hand/camera_info", "ir": "/spot/ir/hand/image"}


def wall(i: int) -> Image:
    """z-depth (H, W) of two slanted walls that fill the picture, with 0.3 mm of noise."""
    rays = CAMERA.rays()
    near = 0.9 / (rays @ [0.2, 0.05, 1.0])
    far = 1.1 / (rays @ [-0.3, -0.1, 1.0])
    depth = np.where(rays[..., 0] < 0.1, near, far) + np.random.default_rng(i).normal(0, 0.0003, CAMERA.shape)
    return depth.astype(np.float32)


@dataclass(frozen=True)
class Robot:
    """What the robot publishes; the defaults are as they should be."""

    frames: int = 12
    radial: bool = False
    scale: float = 1.0
    camera: Camera = CAMERA
    info: bool = True
    amplitude: bool = True
    tf: bool = True
    tf_hole: tuple[int, int] = (1000, 1000)
    root: str = "cell"
    frozen: bool = False
    stamped: bool = True
    future_s: float = 0.0
    black: bool = False
    pause: int = 0
    drives: bool = False


def record(path: Path, robot: Robot) -> Path:
    """A bag of that robot."""
    with BagWriter(path) as bag:
        if robot.tf:
            bag.tf(START, [("body", "hand_depth_sensor", np.eye(4))], static=True)
        for k in range(-10, 4 * (robot.frames + robot.pause) + 10):
            if robot.tf and not robot.tf_hole[0] <= k < robot.tf_hole[1]:
                at = START + k * FRAME // 4
                x = 0.001 * k if not robot.pause else 0.3 * robot.drives * (k > 4 * (robot.frames // 2 + robot.pause // 2))
                bag.tf(at, [(robot.root, "body", se3.exp([x, 0, 0, 0, 0, 0]))])
        for i in range(robot.frames):
            write_frame(bag, robot, i)
    return path


def write_frame(bag: BagWriter, robot: Robot, i: int) -> None:
    """One frame with its CameraInfo and amplitude."""
    depth = wall(0 if robot.frozen else i)
    depth = z_to_radial(CAMERA, depth) if robot.radial else depth
    if robot.black:
        depth[:] = np.nan
    later = robot.pause * (2 * i >= robot.frames)
    at = START + (i + later) * FRAME if robot.stamped else 0
    if robot.info:
        bag.camera_info(NAMES["info"], robot.camera, at)
    if robot.amplitude:
        bag.image(NAMES["ir"], np.full(CAMERA.shape, 50 + i, np.uint16), "mono16", CAMERA.frame_id, at)
    bag.image(NAMES["depth"], depth_counts(depth * robot.scale), "16UC1", CAMERA.frame_id, at + round(robot.future_s * SECOND))


def findings(tmp_path: Path, robot: Robot, **options: str) -> list[Finding]:
    """What the doctor says of that robot's bag."""
    return list(examine_bag(record(tmp_path / "bag", robot), replace(BagOptions(), **options)))  # type: ignore[arg-type]


def worst(said: list[Finding], level: Level = Level.FIX) -> list[str]:
    """Checks that say so, with their text."""
    return [f"{f.check}: {f.what}" for f in said if f.level is level]


def test_a_good_bag_has_no_fault_and_its_meaning_of_depth_is_reported(tmp_path: Path) -> None:
    said = findings(tmp_path, Robot())
    assert worst(said) == []
    text = "\n".join(f.line() for f in said)
    assert "depth /spot/depth/hand/image: Image 16UC1, 12 messages at 15 Hz" in text
    assert "120x90, fx 105.0, 59.5 x 46.4 degrees" in text
    assert "cell -> body -> hand_depth_sensor" in text
    assert "all 12 frames have a pose" in text
    assert "100 % of pixels valid" in text
    assert any(f.check == "z or radial" and f.level is Level.OK for f in said)


FAULTS = {
    "radial": (Robot(radial=True), "z or radial", "looks radial", "--depth radial"),
    "millimetres twice": (Robot(scale=0.001 * 20), "depth", "not metres", "--depth-scale"),
    "one byte": (Robot(scale=0.1), "depth", "no count above", "#561"),
    "another raster's K": (
        Robot(camera=replace(CAMERA, width=240, height=180)),
        "CameraInfo",
        "is 120x90, its CameraInfo 240x180",
        "--info-topic",
    ),
    "no CameraInfo": (Robot(info=False), "topic", "no CameraInfo beside", "depth/hand/camera_info too"),
    "no TF": (Robot(tf=False), "TF", "no /tf and no /tf_static", "record both"),
    "TF with a hole": (Robot(tf_hole=(10, 40)), "TF gaps", "of 12 frames have no pose", "--max-gap-s"),
    "frozen": (Robot(frozen=True), "frozen frames", "11 of 12", "restart the camera"),
    "no stamps": (Robot(stamped=False), "stamps", "no header stamps", "acquisition time"),
    "black": (Robot(black=True), "invalid codes", "0 % of pixels valid", "lens is free"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_each_fault_is_found_and_comes_with_what_to_do(fault: str, tmp_path: Path) -> None:
    robot, check, what, todo = FAULTS[fault]
    said = findings(tmp_path, robot)
    assert not healthy(said)
    assert any(f.level is Level.FIX and f.check == check and what in f.what and todo in f.todo for f in said), worst(said)
    assert all(f.todo for f in said if f.level is not Level.OK)


def test_radial_depth_that_is_declared_is_healthy(tmp_path: Path) -> None:
    assert worst(findings(tmp_path, Robot(radial=True), depth="radial")) == []


def test_missing_amplitude_is_a_note(tmp_path: Path) -> None:
    said = findings(tmp_path, Robot(amplitude=False))
    assert healthy(said)
    assert any("no amplitude" in line for line in worst(said, Level.NOTE))


def test_without_tf_an_initial_pose_is_enough(tmp_path: Path) -> None:
    bag = record(tmp_path / "bag", Robot(tf=False))
    assert worst(list(examine_bag(bag, BagOptions(), initial_pose="0 0 0.8 0 0 0 1"))) == []


@pytest.mark.shared
@pytest.mark.parametrize(
    ("bag", "level"), [("ifm_o3r/bag_radial", Level.FIX), ("azure_kinect_nfov/bag", Level.OK), ("azure_kinect_static/bag", Level.OK)]
)
def test_real_cameras_are_told_apart_by_what_their_depth_is(bag: str, level: Level, shared_data: Path) -> None:
    (told,) = [f for f in examine_bag(shared_data / "real" / bag, BagOptions()) if f.check == "z or radial"]
    assert told.level is level


def test_a_tf_root_other_than_the_cell_is_reported(tmp_path: Path) -> None:
    assert any("root 'odom' is not a cell" in line for line in worst(findings(tmp_path, Robot(root="odom")), Level.NOTE))


def test_a_frame_that_tf_lacks_is_named_with_those_it_has(tmp_path: Path) -> None:
    said = findings(tmp_path, Robot(), cell_frame="plant")
    assert any("'plant'" in line for line in worst(said))


def test_a_truncated_bag_is_reported_and_its_intact_part_examined(tmp_path: Path) -> None:
    bag = record(tmp_path / "bag", Robot())
    file = next(bag.glob("*.mcap"))
    file.write_bytes(file.read_bytes()[: int(file.stat().st_size * 0.8)])
    said = list(examine_bag(bag, BagOptions()))
    assert any(f.check == "bag" and f.level is Level.FIX and "--recover" in f.todo for f in said)
    assert any(f.check == "invalid codes" for f in said)


def test_a_message_that_is_none_is_a_finding(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag") as bag:
        bag.tf(START, [("cell", "hand_depth_sensor", np.eye(4))], static=True)
        for i in range(4):
            write_frame(bag, Robot(), i)
        bag.raw(NAMES["info"], "sensor_msgs/msg/CameraInfo", bytes(20), START + SECOND)
    said = list(examine_bag(tmp_path / "bag", BagOptions()))
    assert any(f.check == "bag" and f.level is Level.FIX and NAMES["info"] in f.what and f.todo for f in said), worst(said)


def test_the_command_exits_1_and_prints_json(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bag = record(tmp_path / "bag", Robot(tf=False))
    assert cli.main(["doctor", str(bag), "--json"]) == 1
    told = json.loads(capsys.readouterr().out)
    assert told["healthy"] is False
    assert {f["level"] for f in told["findings"]} <= {"ok", "note", "fix"}
    assert cli.main(["doctor", str(record(tmp_path / "good", Robot()))]) == 0
    assert "0 to fix" in capsys.readouterr().out


def test_a_scene_that_cannot_be_read_is_a_finding(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "broken.yaml").write_text("parts: 3\n")
    assert cli.main(["doctor", "--scene", str(tmp_path / "broken.yaml")]) == 1
    assert "broken.yaml" in capsys.readouterr().out


def test_a_scene_that_is_not_there_is_a_wrong_call(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["doctor", "--scene", str(tmp_path / "none.yaml")]) == 2
    assert "none.yaml" in capsys.readouterr().err


def test_a_bag_and_live_at_once_is_a_wrong_call(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["doctor", str(tmp_path), "--live"]) == 2
    assert "one at a time" in capsys.readouterr().err


def test_python_outside_the_wheels_is_to_be_mended() -> None:
    assert host.python((3, 12)).level is Level.OK
    assert host.python((3, 13)).level is Level.FIX


def test_a_missing_library_names_its_package(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(host, "LIBRARIES", {"libno-such-thing.so.9": "libno9"})
    (found,) = host.libraries()
    assert (found.level, found.todo) == (Level.FIX, "apt-get install libno9")


@pytest.fixture
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a domain in which nothing will ever come."""
    monkeypatch.setattr("tof_ros.survey.PATIENCE_S", 0.5)


@pytest.mark.usefixtures("impatient", "ros_domain")
def test_a_ros_domain_without_topics_is_reported(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["doctor", "--live", "--seconds", "0.2"]) == 1
    assert "no publisher of images" in capsys.readouterr().out


@pytest.mark.dds
@pytest.mark.usefixtures("impatient", "ros_domain")
def test_publishers_without_messages_are_faults() -> None:
    import rclpy
    from sensor_msgs.msg import Image

    from tof_ros.environment import ros_context
    from toftwin.doctor.live import examine_live

    with ros_context() as context:
        node = rclpy.create_node("silent", context=context)
        node.create_publisher(Image, "/depth/hand/image", 5)
        said = list(examine_live(BagOptions(), None, None, 2.0))
        node.destroy_node()
    assert any("not one message came" in line for line in worst(said)), said


@pytest.mark.dds
def test_a_live_camera_is_recorded_and_examined(ros_domain: int) -> None:
    """What is published now is judged as a bag of it would be, with the QoS of its publishers besides."""
    from tests.toftwin.live_camera import live_camera
    from toftwin.doctor.live import examine_live

    with live_camera(CAMERA, wall):
        said = list(examine_live(BagOptions(), None, None, 2.0))
    text = "\n".join(f.line() for f in said)
    assert "/depth/hand/image: " in text
    assert "best_effort" in text
    assert any(f.check == "z or radial" and f.level is Level.OK for f in said), text
    assert worst(said) == []


@pytest.mark.dds
@pytest.mark.usefixtures("ros_domain")
def test_a_camera_that_is_discovered_late_is_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    from rclpy.node import Node

    from tests.toftwin.live_camera import live_camera
    from toftwin.doctor.live import examine_live

    graph, looks = Node.get_topic_names_and_types, iter(range(10**6))
    monkeypatch.setattr(Node, "get_topic_names_and_types", lambda node: graph(node) if next(looks) > 2 else [])
    with live_camera(CAMERA, wall):
        said = list(examine_live(BagOptions(), None, None, 1.0))
    assert worst(said) == []
    assert any(f.check == "z or radial" and f.level is Level.OK for f in said), said


@pytest.mark.dds
@pytest.mark.usefixtures("impatient", "ros_domain")
def test_of_a_live_camera_without_camera_info_that_topic_is_named() -> None:
    from tests.toftwin.live_camera import live_camera
    from toftwin.doctor.live import examine_live

    with live_camera(CAMERA, wall, with_info=False):
        said = list(examine_live(BagOptions(), None, None, 2.0))
    assert any("/depth/hand/camera_info has a publisher, but nothing came in" in f.what for f in said), said
    (line,) = [f.line() for f in said if f.level is Level.FIX]
    assert "the ROS graph: has no CameraInfo beside '/depth/hand/image'; record /depth/hand/camera_info too" in line


def test_publishers_that_we_cannot_hear_are_named_with_the_policy() -> None:
    from tof_ros.survey import Publisher

    said = list(
        publishers({"/tf_static": [Publisher("/old", "reliable", "volatile")], "/tf": [Publisher("/fast", "best_effort", "volatile")]}, 5.0)
    )
    assert [f.level for f in said] == [Level.FIX, Level.FIX]
    assert "RELIABILITY" in said[0].todo
    assert "DURABILITY" in said[1].todo


def test_a_pause_while_the_camera_moves_is_a_drive_between_views(tmp_path: Path) -> None:
    said = findings(tmp_path, Robot(pause=30, drives=True))
    assert any(
        "pauses 1 times, up to 2.1 s; the camera is elsewhere after each: views of one session" in f.what
        for f in said
        if f.level is Level.OK
    )
    assert not any("frames were lost" in f.todo for f in said)


def test_a_pause_while_the_camera_stands_is_loss(tmp_path: Path) -> None:
    said = findings(tmp_path, Robot(pause=30))
    assert any("pauses 1 times, up to 2.1 s" in f.what and "frames were lost" in f.todo for f in said if f.level is Level.NOTE)


@pytest.mark.dds
def test_the_graph_s_own_outputs_are_not_examined(ros_domain: int) -> None:
    import rclpy
    from sensor_msgs.msg import CameraInfo, Image

    from tests.toftwin.live_camera import live_camera
    from tof_ros.environment import ros_context
    from toftwin.doctor.live import examine_live

    with ros_context() as context, live_camera(CAMERA, wall):
        node = rclpy.create_node("preproc", context=context)
        for topic in ("preproc/depth", "label/depth", "infer/depth"):
            node.create_publisher(Image, f"/spot/{topic}", 5)
            node.create_publisher(CameraInfo, f"/spot/{topic.partition('/')[0]}/camera_info", 5)
        said = list(examine_live(BagOptions(), None, None, 2.0))
        node.destroy_node()
    assert any("the graph runs: 6 topics of its own, such as /spot/infer/camera_info" in f.what for f in said)
    assert worst(said) == []
    assert not any("/spot/preproc" in f.what for f in said)


EXECUTORS = {
    "": ({"Own": "", "Rclpy": ""}, Level.OK, "Own runs"),
    "ours does not work": ({"Own": "no attribute '_tasks'", "Rclpy": ""}, Level.NOTE, "rclpy's Rclpy runs the nodes"),
    "nothing works": ({"Own": "no attribute '_tasks'", "Rclpy": "nothing ran"}, Level.FIX, "no node can run: nothing ran"),
}


@pytest.mark.parametrize("what", EXECUTORS)
def test_the_executor_that_runs_the_nodes_is_reported(what: str) -> None:
    failures, level, said = EXECUTORS[what]
    finding = host.executor(failures)
    assert finding.level is level
    assert said in finding.what
    assert bool(finding.todo) == (level is not Level.OK)


@pytest.mark.dds
def test_the_host_s_rclpy_is_named_with_its_version_and_executor(ros_domain: int) -> None:
    ros, executor = host.middleware()
    assert "rclpy 7" in ros.what
    assert "over rmw_" in ros.what
    assert executor.level is Level.OK
    assert executor.what.startswith("DirectExecutor runs")
