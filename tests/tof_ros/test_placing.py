# SPDX-License-Identifier: Apache-2.0
"""A robot whose TF has no cell: placed by a parameter or by a pose drawn in RViz; TF, the CAD and the camera's path are seen."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from tests.tof_inspect.made import EYE, plate, seen
from tof_core import se3

pytest.importorskip("rclpy", reason="no ROS 2 here")
from tests.tof_inspect.test_node import written
from tests.tof_ros.peers import Observer, values, wait_for
from tests.tof_ros.view_source import ViewSource

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from tof_core.arrays import Float

pytestmark = pytest.mark.dds
T_ODOM_CELL = se3.from_quat((3.0, -1.0, 0.2), (0.0, 0.0, np.sin(0.2), np.cos(0.2)))
POSE = f"odom: 3 -1 0.2 0 0 {np.sin(0.2)} {np.cos(0.2)}"


class Bench:
    """A `sim_label`, a robot with the frame odom, and somebody who listens late."""

    def __init__(self, context: Any, node: Any) -> None:
        from tf2_msgs.msg import TFMessage

        from tof_ros import qos

        self.node, self.observer = node, Observer(context)
        self.source = ViewSource(self.observer.node, root="odom", T_root_cell=T_ODOM_CELL)
        self.static: dict[tuple[str, str], Float] = {}
        self.moving: dict[str, str] = {}
        self.observer.node.create_subscription(TFMessage, "/tf_static", self._latched, qos.TF_STATIC)
        self.observer.node.create_subscription(TFMessage, "/tf", self._moved, qos.TF)

    def _latched(self, message: Any) -> None:
        for t in message.transforms:
            v, q = t.transform.translation, t.transform.rotation
            self.static[t.header.frame_id, t.child_frame_id] = se3.from_quat((v.x, v.y, v.z), (q.x, q.y, q.z, q.w))

    def _moved(self, message: Any) -> None:
        self.moving |= {t.child_frame_id: t.header.frame_id for t in message.transforms}

    def late(self, topic: str, kind: Any) -> Any:
        """The latched message of a topic, as somebody hears it who comes now."""
        from tof_ros import qos

        heard: list[Any] = []
        subscription = self.observer.node.create_subscription(kind, topic, heard.append, qos.LATCHED)
        wait_for(lambda: heard, what=f"for {topic}")
        self.observer.node.destroy_subscription(subscription)
        return heard[-1]

    def view(self) -> Any:
        """Send one view until it is taken."""
        kept = self.node.tally.kept
        wait_for(lambda: self.source.matched)
        view = self.source.send(seen(plate()))
        wait_for(lambda: self.node.tally.kept > kept, what=str(self.node.tally.skipped))
        return view

    def draw(self, frame: str, T: Float) -> None:
        """RViz's 2D Pose Estimate."""
        from geometry_msgs.msg import PoseWithCovarianceStamped

        from tof_ros import messages, qos

        out = self.observer.node.create_publisher(PoseWithCovarianceStamped, "/spot/initialpose", qos.OUTPUT)
        wait_for(out.get_subscription_count)
        chain = self.node._chain
        out.publish(messages.pose(T, np.zeros((6, 6)), messages.header(0, frame)))
        wait_for(lambda: self.node._chain is not chain and self.node.active, what="for a new session")


@pytest.fixture
def started(ros_domain: int, tmp_path: Path) -> Iterator[Callable[..., Bench]]:
    from contextlib import ExitStack

    from tof_ros.environment import parameter_overrides, ros_context
    from tof_ros.spin import spinning
    from tof_sim_label.node import make_node

    with ExitStack() as stack:
        context = stack.enter_context(ros_context(domain=ros_domain))

        def start(**values: Any) -> Bench:
            overrides = parameter_overrides(
                {"live.scene": str(written(plate(), tmp_path)), "live.settle_s": 0.5} | {f"live.{k}": v for k, v in values.items()}
            )
            node = make_node(context=context, namespace="spot", parameter_overrides=overrides)
            bench = Bench(context, node)
            stack.enter_context(spinning([node, bench.observer.node]))
            wait_for(lambda: node.active)
            return bench

        yield start


def test_a_parameter_places_the_cell_and_all_of_it_can_be_seen(started: Callable[..., Bench]) -> None:
    from nav_msgs.msg import Path
    from visualization_msgs.msg import MarkerArray

    bench = started(initial_pose=POSE)
    markers = bench.late("/spot/scene/markers", MarkerArray).markers
    assert {m.text for m in markers} == set(plate().names)
    assert {m.header.frame_id for m in markers} == {"cell"}
    view = bench.view()
    wait_for(lambda: ("odom", "cell") in bench.static)
    np.testing.assert_allclose(bench.static["odom", "cell"], T_ODOM_CELL, atol=1e-9)
    wait_for(lambda: f"{view.camera.frame_id}_aligned" in bench.moving)
    assert bench.moving[f"{view.camera.frame_id}_aligned"] == "cell"
    path = bench.late("/spot/label/path", Path)
    assert (path.header.frame_id, len(path.poses)) == ("cell", 1)
    p = path.poses[0].pose.position
    np.testing.assert_allclose((p.x, p.y, p.z), EYE[:3, 3], atol=0.02)
    green = [m.text for m in bench.late("/spot/scene/markers", MarkerArray).markers if m.color.g > 1.5 * m.color.r]
    assert "block" in green


def test_a_pose_drawn_in_a_frame_of_tf_places_the_cell_and_begins_the_session_anew(started: Callable[..., Bench]) -> None:
    bench = started(initial_pose="odom: 0 0 0.2 0 0 0 1")
    drawn = T_ODOM_CELL.copy()
    drawn[2, 3] = 0.0
    bench.draw("odom", drawn)
    bench.view()
    wait_for(lambda: ("odom", "cell") in bench.static and np.allclose(bench.static["odom", "cell"], T_ODOM_CELL, atol=1e-9))


def test_a_pose_drawn_in_the_cell_says_where_the_body_is(started: Callable[..., Bench]) -> None:
    wrong = T_ODOM_CELL.copy()
    wrong[:2, 3] += 0.05
    bench = started(initial_pose="odom: " + " ".join(str(v) for v in (*wrong[:3, 3], 0, 0, np.sin(0.2), np.cos(0.2))))
    bench.view()
    bench.draw("cell", se3.from_quat((0.2, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)))  # where the source's body stands
    bench.view()
    wait_for(lambda: np.allclose(bench.static["odom", "cell"], T_ODOM_CELL, atol=1e-6), what=str(bench.static))


def test_views_of_a_misplaced_cell_have_no_pose_and_the_diagnostics_say_why_and_what_to_do(started: Callable[..., Bench]) -> None:
    from geometry_msgs.msg import PoseWithCovarianceStamped
    from sensor_msgs.msg import Image

    from tof_core.decode import pixels, stamp_ns
    from tof_ros import qos

    bench = started(initial_pose=POSE.replace("3 -1 0.2", "2.079 -1.389 0.2"))  # 1 m away from the camera
    heard: dict[str, list[Any]] = {"pose": [], "mask": []}
    node = bench.observer.node
    node.create_subscription(PoseWithCovarianceStamped, "/spot/label/pose", heard["pose"].append, qos.OUTPUT)
    node.create_subscription(Image, "/spot/label/mask", heard["mask"].append, qos.OUTPUT)
    wait_for(lambda: bench.node.count_subscribers("/spot/label/mask") and bench.node.count_subscribers("/spot/label/pose"))
    view = bench.view()
    wait_for(lambda: [stamp_ns(m) for m in heard["mask"]] == [view.stamp_ns], what="for the label")
    assert not pixels(heard["mask"][0]).any()
    status = bench.observer.status("spot/sim_label", lambda s: "no view fits the CAD" in s.message)
    assert status.level == b"\x01"
    assert "the cell is not where live.initial_pose places it: correct it, or draw the pose in RViz" in status.message
    counted = {k: v for k, v in values(status).items() if k.startswith("verdict.")}
    assert counted == {"verdict.too far from the robot's pose": "1"}
    wait_for(lambda: any("no view fits the CAD" in line for line in bench.observer.log), what="for the log")
    bench.draw("odom", T_ODOM_CELL)
    good = bench.view()
    wait_for(lambda: heard["pose"], what="for the pose of a view that is accepted")
    assert [stamp_ns(m) for m in heard["pose"]] == [good.stamp_ns]
    wait_for(lambda: len(bench.node._path.poses) == 1, what="for the path, which follows the pose")
    bench.observer.status("spot/sim_label", lambda s: s.level == b"\x00" and sum(k.startswith("verdict.") for k in values(s)) == 2)


def test_a_pose_without_height_where_nothing_says_how_high_the_cell_is(started: Callable[..., Bench]) -> None:
    bench = started()
    drawn = T_ODOM_CELL.copy()
    drawn[2, 3] = 0.0
    bench.draw("odom", drawn)
    said = wait_for(lambda: [line for line in bench.observer.log if "height of the cell unknown" in line], what="for the warning")
    assert "the scene's origin is assumed at height 0 of 'odom', not tilted" in said[0]
    assert "pass --initial-pose 'odom: 3.000 -1.000 HEIGHT 0 0 0.1987 0.9801'" in said[0]
    assert bench.node._placing.source == "the pose on initialpose (of unknown height)"
    bench.draw("odom", T_ODOM_CELL)
    bench.draw("odom", drawn)
    assert bench.node._placing.source == "the pose on initialpose"
    np.testing.assert_allclose(bench.node._chain.placed.T_frame_cell, T_ODOM_CELL, atol=1e-9)


def test_a_pose_drawn_in_another_frame_keeps_the_height_that_tf_carries_there(started: Callable[..., Bench]) -> None:
    from tf2_msgs.msg import TFMessage

    from tof_ros import messages, qos

    bench = started(initial_pose=POSE)
    T_map_odom = se3.from_quat((0.0, 0.0, 0.5), (0.0, 0.0, 0.0, 1.0))
    static = bench.observer.node.create_publisher(TFMessage, "/tf_static", qos.LATCHED)
    static.publish(TFMessage(transforms=[messages.transform("map", "odom", T_map_odom)]))
    bench.view()
    drawn = T_map_odom @ T_ODOM_CELL
    drawn[2, 3] = 0.0
    bench.draw("map", drawn)
    np.testing.assert_allclose(bench.node._chain.placed.T_frame_cell, T_map_odom @ T_ODOM_CELL, atol=1e-9)
    assert not [line for line in bench.observer.log if "height of the cell unknown" in line]


@pytest.mark.parametrize("x", [3.0, 3.4])
def test_a_cell_that_tf_has_elsewhere_than_the_parameter_is_reported(started: Callable[..., Bench], x: float) -> None:
    from tf2_msgs.msg import TFMessage

    from tof_ros import messages, qos

    bench = started(initial_pose=POSE.replace("3 ", f"{x} "))
    static = bench.observer.node.create_publisher(TFMessage, "/tf_static", qos.LATCHED)
    static.publish(TFMessage(transforms=[messages.transform("odom", "cell", T_ODOM_CELL)]))
    wait_for(lambda: "cell" in bench.node._chain.transforms.frames())
    bench.view()
    assert bench.node._placing.source == "TF"
    if x == 3.0:
        assert bench.node._placing._elsewhere() == []
    else:
        status = bench.observer.status("spot/sim_label", lambda s: "live.initial_pose is not used" in s.message)
        assert "TF has 'cell' already, 0.400 m and 0.0 deg from it" in status.message


def test_nothing_is_published_if_that_is_turned_off_and_an_invalid_pose_is_reported(started: Callable[..., Bench]) -> None:
    bench = started(initial_pose=POSE, publish_tf=False)
    bench.view()
    wait_for(lambda: bench.node._path.poses)
    assert bench.static == {}
    assert not any(name.endswith("_aligned") for name in bench.moving)


def test_labels_with_a_share_of_a_core_skip_dwells_and_no_view_waits_for_them(started: Callable[..., Bench]) -> None:
    bench = started(initial_pose=POSE, share=0.001, settle_s=0.0)
    for _ in range(3):
        bench.view()
    wait_for(lambda: bench.node._path.poses, what="for the label of the first dwell")
    assert bench.node.figures()["verdict.skipped"] == "1"  # the second; the third has not ended
    assert bench.node.flush() == "1 view labelled"
    assert len(bench.node._path.poses) == 2


def test_a_pose_that_is_none_is_why_the_node_is_not_active(ros_domain: int, tmp_path: Path) -> None:
    from tof_ros.environment import parameter_overrides, ros_context
    from tof_ros.spin import spinning
    from tof_sim_label.node import make_node

    with ros_context(domain=ros_domain) as context:
        overrides = parameter_overrides({"live.scene": str(written(plate(), tmp_path)), "live.initial_pose": "here"})
        node = make_node(context=context, parameter_overrides=overrides)
        with spinning([node]):
            wait_for(lambda: node.trouble)
            assert "not activated: live.initial_pose: 'here' is not 'x y z qx qy qz qw'" in node.trouble
