# SPDX-License-Identifier: Apache-2.0
"""A node that hears nothing says so: which topic, who publishes it, what else could be meant, and the flag that says it."""

from __future__ import annotations

import time
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, cast

import pytest

pytest.importorskip("rclpy", reason="no ROS 2 here")
from tests.tof_ros.peers import Observer, wait_for
from tof_ros.diagnostics import Tally
from tof_ros.hearing import CAMERA_SILENT, VIEWS_SILENT, Frames, Hearing, no_publisher

if TYPE_CHECKING:
    from collections.abc import Iterator

IMAGE, POINTS = "sensor_msgs/msg/Image", "sensor_msgs/msg/PointCloud2"
DEPTH = Frames("depth/hand/image", "/depth/hand/image", IMAGE, "input.depth_topic")
CASES = {
    "a forgotten namespace": (
        DEPTH,
        "/",
        {"/spot/depth/hand/image": IMAGE, "/spot/camera/hand/image": IMAGE},
        "it is published as /spot/depth/hand/image: start this node with --namespace spot (ros2 run: -r __ns:=/spot)",
    ),
    "a namespace too many": (
        Frames("depth/hand/image", "/spot/depth/hand/image", IMAGE, "input.depth_topic"),
        "/spot",
        {"/depth/hand/image": IMAGE},
        "it is published as /depth/hand/image: start this node with no --namespace",
    ),
    "another name": (
        DEPTH,
        "/",
        {"/camera/depth/image_rect_raw": IMAGE, "/camera/color/image_raw": IMAGE},
        "depth may be on /camera/depth/image_rect_raw: pass --param preproc.input.depth_topic=/camera/depth/image_rect_raw",
    ),
    "a cloud instead": (
        DEPTH,
        "/",
        {"/ifm3d/camera/cloud": POINTS},
        "depth may be on /ifm3d/camera/cloud: pass --param preproc.input.points_topic=/ifm3d/camera/cloud",
    ),
    "our own outputs are no candidates": (
        DEPTH,
        "/",
        {"/label/depth": IMAGE, "/preproc/depth": IMAGE},
        "no other topic here looks like depth",
    ),
    "nothing at all": (DEPTH, "/", {}, "does the driver run, in this ROS_DOMAIN_ID"),
    "preproc does not run": (
        Frames("preproc/depth", "/spot/preproc/depth", IMAGE),
        "/spot",
        {"/spot/depth/hand/image": IMAGE},
        "start the node that publishes it in the namespace /spot",
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_a_topic_without_publisher_comes_with_what_could_be_meant(case: str) -> None:
    frames, namespace, published, said = CASES[case]
    line = no_publisher(frames, published, "preproc", namespace)
    assert said in line
    assert line.startswith(f"no frame for 5 s: {frames.topic} has no publisher")


@pytest.mark.parametrize(
    ("frames", "said"), [(DEPTH, CAMERA_SILENT), (Frames("preproc/depth", "/spot/preproc/depth", IMAGE), VIEWS_SILENT)]
)
def test_of_a_silent_publisher_it_is_said_where_to_look(frames: Frames, said: str, monkeypatch: pytest.MonkeyPatch) -> None:
    from sensor_msgs.msg import Image

    monkeypatch.setattr("tof_ros.hearing.SILENT_S", 0.0)
    node = SimpleNamespace(
        resolve_topic_name=lambda _: frames.topic,
        get_publishers_info_by_topic=lambda _: [SimpleNamespace(node_name="preproc", node_namespace="/spot")],
    )
    hearing = Hearing(cast("Any", node), Tally())
    hearing.add(frames.name, Image, frames.parameter)
    assert hearing.silence() == f"no frame for 0 s: {frames.topic} has publishers (/spot/preproc), but no message arrived: {said}"


@pytest.fixture
def context(ros_domain: int) -> Iterator[Any]:
    from tof_ros.environment import ros_context

    with ros_context(domain=ros_domain) as context:
        yield context


@pytest.mark.dds
def test_a_forgotten_namespace_is_said_once_with_the_flag_and_the_first_frame_too(context: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    from sensor_msgs.msg import Image

    from tof_preproc.node import make_node
    from tof_ros import hearing, qos
    from tof_ros.environment import parameter_overrides
    from tof_ros.spin import spinning

    monkeypatch.setattr(hearing, "SILENT_S", 1.0)
    observer = Observer(context)
    robot = observer.node.create_publisher(Image, "/spot/depth/hand/image", qos.sensor(reliable=True))
    node = make_node(context=context, parameter_overrides=parameter_overrides({"live.need_tf": False}))
    with spinning([observer.node, node]):
        status = observer.status("preproc", lambda s: "no frame" in s.message)
        assert status.level == b"\x03"
        assert "start this node with --namespace spot" in status.message
        time.sleep(2.5)
        assert sum("no frame for" in line for line in observer.log) == 1
        right = observer.node.create_publisher(Image, "/depth/hand/image", qos.sensor(reliable=True))
        wait_for(right.get_subscription_count)
        right.publish(Image())
        wait_for(lambda: any("frames come on /depth/hand/image" in line for line in observer.log))
        status = observer.status("preproc", lambda s: "but no message arrived" in s.message)
        assert "/depth/hand/image has publishers (/observer)" in status.message
    observer.node.destroy_publisher(robot)


@pytest.mark.dds
def test_a_node_says_what_it_hears_once_it_is_active(context: Any, capfd: pytest.CaptureFixture[str]) -> None:
    from tof_preproc.node import make_node

    make_node(context=context, namespace="spot").destroy_node()
    said = capfd.readouterr().err
    heard = "/spot/depth/hand/image, /spot/depth/hand/camera_info, /spot/ir/hand/image, /spot/hand/temperature"
    assert f"active, hears {heard}" in said


@pytest.mark.dds
def test_a_transform_listener_that_dies_takes_its_node_with_it(context: Any) -> None:
    from tof_preproc.node import make_node
    from tof_ros.spin import spinning

    def fail() -> None:
        raise ZeroDivisionError("on purpose")

    node = make_node(context=context)
    with spinning([node]) as (spinner,):
        assert spinner.alive
        (listener,) = node.helpers
        listener.node.create_guard_condition(fail).trigger()
        wait_for(lambda: not spinner.alive)
        assert isinstance(spinner.error, ZeroDivisionError)


@pytest.mark.dds
def test_a_node_that_is_renamed_has_a_listener_of_another_name(ros_domain: int) -> None:
    from tof_preproc.node import make_node
    from tof_ros.environment import ros_context

    with ros_context(["-r", "__node:=left", "-r", "/tf:=/robot/tf"], domain=ros_domain) as renamed:
        node = make_node(context=renamed)
        listener = node.helpers[0].node
        assert (node.get_name(), listener.get_name()) == ("left", "left_tf")
        assert sorted(s.topic_name for s in listener.subscriptions) == ["/robot/tf", "/tf_static"]
        node.destroy_node()
