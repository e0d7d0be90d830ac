# SPDX-License-Identifier: Apache-2.0
"""The node `infer` over DDS: same numbers as the session, uncertain pixels marked, every frame accounted for."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from tests.tof_infer.made import CAMERA, measured
from tests.tof_ros.peers import Observer, wait_for
from tof_core.camera import Camera
from tof_core.decode import pixels, stamp_ns
from tof_core.errors import RefusedError
from tof_infer.config import InferConfig
from tof_infer.session import Session

pytest.importorskip("rclpy", reason="no ROS 2 here")

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from tof_core.capture import Capture
    from tof_infer.session import Repaired

pytestmark = [pytest.mark.dds, pytest.mark.train]


class Bench:
    """An `infer` in one thread, a camera and an observer in another."""

    def __init__(self, node: Any, observer: Observer) -> None:
        from sensor_msgs.msg import CameraInfo, Image, Temperature, TimeReference

        from tof_infer.node import OUTPUTS
        from tof_ros import qos

        self.heard: list[tuple[str, Any]] = []
        self.log, peer = observer.log, observer.node
        self.publishers = {
            name: peer.create_publisher(kind, f"spot/{name}", qos.sensor(reliable=True))
            for name, kind in {
                "depth/hand/image": Image,
                "depth/hand/camera_info": CameraInfo,
                "ir/hand/image": Image,
                "hand/temperature": Temperature,
            }.items()
        }
        for name, kind in {**OUTPUTS, "done": TimeReference}.items():
            peer.create_subscription(kind, f"spot/infer/{name}", lambda m, name=name: self.heard.append((name, m)), qos.OUTPUT)
        wait_for(lambda: all(p.get_subscription_count() for p in self.publishers.values()) and peer.count_publishers("spot/infer/done"))
        time.sleep(0.3)

    def send(self, capture: Capture, camera: Camera = CAMERA) -> int:
        """Publish a capture as the camera driver would; gives its stamp."""
        from sensor_msgs.msg import Temperature

        from tof_ros import messages

        head = messages.header(capture.stamp_ns, CAMERA.frame_id)
        self.publishers["hand/temperature"].publish(Temperature(header=head, temperature=capture.temperature))
        self.publishers["depth/hand/camera_info"].publish(messages.camera_info(camera, head))
        if capture.amplitude is not None:
            self.publishers["ir/hand/image"].publish(messages.image(capture.amplitude, "32FC1", head))
        time.sleep(0.2)
        self.publishers["depth/hand/image"].publish(messages.image(capture.depth, "32FC1", head))
        return capture.stamp_ns

    def outputs(self, stamp: int) -> dict[str, Any]:
        """What was published for a frame, once it is done."""

        def found() -> dict[str, Any]:
            return {name: m for name, m in self.heard if stamp_ns(m) == stamp}

        wait_for(lambda: "done" in found() and (found()["done"].source != "kept" or len(found()) == 5))
        return found()


@pytest.fixture(scope="module")
def bench(ros_domain: int, model: Path) -> Iterator[Bench]:
    from tof_infer.node import make_node
    from tof_ros.environment import parameter_overrides, ros_context
    from tof_ros.spin import spinning

    values = {"infer.model": str(model), "live.reliable": True}
    with ros_context(domain=ros_domain) as context:
        node = make_node(context=context, namespace="spot", parameter_overrides=parameter_overrides(values))
        observer = Observer(context)
        with spinning([node, observer.node]):
            yield Bench(node, observer)


def cloud_of(message: Any) -> tuple[list[str], Any]:
    """Names of the fields of a PointCloud2 of floats, and its values (H, W, fields)."""
    values = np.frombuffer(bytes(message.data), "<f4").reshape(message.height, message.width, -1)
    return [field.name for field in message.fields], values


def expected(model: Path, capture: Capture) -> Repaired:
    return Session(InferConfig(model=str(model))).repair(capture)


def test_live_numbers_are_the_sessions(bench: Bench, model: Path) -> None:
    capture = measured(600)
    out = bench.outputs(bench.send(capture))
    want = expected(model, capture)
    np.testing.assert_array_equal(pixels(out["depth"]), want.depth)
    names, cloud = cloud_of(out["points"])
    assert names == ["x", "y", "z", "intensity"]
    np.testing.assert_array_equal(cloud[..., 2], want.depth)
    np.testing.assert_array_equal(cloud[..., 3], capture.amplitude)
    np.testing.assert_array_equal(pixels(out["sigma"]), want.sigma)
    assert (out["depth"].encoding, out["sigma"].encoding) == ("32FC1", "32FC1")
    assert out["camera_info"].k[0] == CAMERA.fx
    assert {m.header.frame_id for name, m in out.items() if name != "done"} == {"hand_depth"}


def test_a_frame_all_invalid_is_a_frame(bench: Bench) -> None:
    capture = measured(601)
    capture.depth[:] = np.nan
    out = bench.outputs(bench.send(capture))
    assert np.isnan(pixels(out["depth"])).all()


def test_another_camera_is_refused_and_reported_once_with_the_remedy_and_the_node_continues(
    bench: Bench, model: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tof_ros.news.QUIET_S", 0.0)  # as if each frame came after a long time
    other = Camera(44, 30, 60.0, 60.0, 21.5, 14.5, frame_id="hand_depth")
    for index in (602, 603, 604):
        assert bench.outputs(bench.send(measured(index), other))["done"].source == "refused"
    wait_for(lambda: any("skipped, refused" in line for line in bench.log))
    (said,) = [line for line in bench.log if "skipped, refused" in line]
    assert said.endswith("start with --param infer.infer.force=true (ros2 run: -p infer.force:=true) and check with toftwin evaluate")
    out = bench.outputs(bench.send(measured(605)))
    np.testing.assert_array_equal(pixels(out["depth"]), expected(model, measured(605)).depth)


def test_while_nobody_is_subscribed_the_network_runs_once_a_second_and_refusals_go_on(
    ros_domain: int, model: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from tof_infer.node import make_node
    from tof_ros.environment import parameter_overrides, ros_context

    runs: list[int] = []
    repair = Session.repair

    def counted(session: Session, capture: Capture) -> Repaired:
        runs.append(capture.stamp_ns)
        return repair(session, capture)

    monkeypatch.setattr(Session, "repair", counted)
    with ros_context(domain=ros_domain) as context:
        node = make_node(context=context, namespace="alone", parameter_overrides=parameter_overrides({"infer.model": str(model)}))
        node.trigger_configure()
        for k in range(5):
            node._repair(measured(610 + k))
        assert runs == [measured(610).stamp_ns]
        node._repaired -= 1.0
        node._repair(measured(616))
        assert runs[1:] == [measured(616).stamp_ns]
        with pytest.raises(RefusedError):
            node._repair(replace(measured(617), camera=replace(CAMERA, fx=2 * CAMERA.fx)))
        node.destroy_node()
