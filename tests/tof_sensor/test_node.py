# SPDX-License-Identifier: Apache-2.0
"""The node `sensor` over DDS: the simulator's numbers, repeated frames kept, normals waited for, faults named."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from tests.tof_sensor.test_simulator import CAMERA, wall
from tof_core.decode import pixels, stamp_ns
from tof_sensor.effects.photon_law import PhotonLaw
from tof_sensor.effects.range_offset import RangeOffset
from tof_sensor.model import SensorModel, save_model
from tof_sensor.simulator import Simulator, SimulatorConfig

pytest.importorskip("rclpy", reason="no ROS 2 here")

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from tof_core.capture import Capture

pytestmark = pytest.mark.dds
MODEL = SensorModel((RangeOffset(0.02), PhotonLaw(shot_m=0.002, reference=100.0)), gain=200.0)


class Bench:
    """The node in one thread, a simulator and an observer in another."""

    def __init__(self, peer: Any) -> None:
        from sensor_msgs.msg import CameraInfo, Image, TimeReference

        from tof_ros import qos
        from tof_sensor.node import OUTPUTS

        self.heard: list[tuple[str, Any]] = []
        kinds = {"depth/image": Image, "depth/camera_info": CameraInfo, "ir/image": Image, "normals": Image}
        self.publishers = {name: peer.create_publisher(kind, f"sim/{name}", qos.sensor(reliable=True)) for name, kind in kinds.items()}
        for name, kind in {**OUTPUTS, "done": TimeReference}.items():
            peer.create_subscription(kind, f"sensor/{name}", lambda m, name=name: self.heard.append((name, m)), qos.OUTPUT)
        wait_for(lambda: all(p.get_subscription_count() for p in self.publishers.values()) and peer.count_publishers("sensor/done"))
        time.sleep(0.3)

    def send(self, ideal: Capture, normal: Any = None) -> int:
        """Publish an ideal frame as a simulator would."""
        from tof_ros import messages

        head = messages.header(ideal.stamp_ns, "sim_camera")
        assert ideal.amplitude is not None
        self.publishers["depth/camera_info"].publish(messages.camera_info(CAMERA, head))
        self.publishers["ir/image"].publish(messages.image(ideal.amplitude, "32FC1", head))
        time.sleep(0.2)
        self.publishers["depth/image"].publish(messages.image(ideal.depth, "32FC1", head))
        if normal is not None:
            time.sleep(0.2)
            self.publishers["normals"].publish(messages.image(normal, "32FC3", head))
        return ideal.stamp_ns

    def outputs(self, stamp: int) -> dict[str, Any]:
        """What was published for a frame, once it is done."""

        def found() -> dict[str, Any]:
            return {name: m for name, m in self.heard if stamp_ns(m) == stamp}

        wait_for(lambda: "done" in found() and (found()["done"].source != "kept" or len(found()) == 4))
        return found()


def wait_for(condition: Callable[[], Any], seconds: float = 30.0) -> None:
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, "timed out"
        time.sleep(0.01)


@pytest.fixture(scope="module")
def bench(ros_domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bench]:
    import rclpy

    from tof_ros.environment import parameter_overrides, ros_context
    from tof_ros.spin import spinning
    from tof_sensor.node import make_node

    file: Path = tmp_path_factory.mktemp("sensor") / "sensor.yaml"
    save_model(MODEL, file)
    values = {"sensor.model": str(file), "live.normals_topic": "sim/normals"}
    with ros_context(domain=ros_domain) as context:
        node = make_node(context=context, parameter_overrides=parameter_overrides(values))
        peer = rclpy.create_node("peer", context=context)
        with spinning([node, peer]):
            yield Bench(peer)


def test_live_numbers_are_the_simulators_and_normals_are_waited_for(bench: Bench) -> None:
    ideal, tilted = wall(10**9, albedo=0.6), np.broadcast_to(np.array([0.0, 0.6, -0.8], np.float32), (*CAMERA.shape, 3)).copy()
    out = bench.outputs(bench.send(ideal, tilted))
    expected = Simulator(SimulatorConfig(), MODEL).measured(ideal, tilted)
    np.testing.assert_array_equal(pixels(out["depth"]), expected.depth)
    np.testing.assert_array_equal(pixels(out["amplitude"]), expected.amplitude)
    assert out["camera_info"].k[0] == CAMERA.fx
    assert out["depth"].header.frame_id == "sim_camera"


def test_a_frame_like_the_last_is_a_frame_with_noise_of_its_own(bench: Bench) -> None:
    first, second = (bench.outputs(bench.send(wall(k * 10**9, albedo=0.6))) for k in (2, 3))
    assert second["done"].source == "kept"
    difference = pixels(first["depth"]) - pixels(second["depth"])
    assert np.isfinite(difference).all()
    assert 1e-4 < np.std(difference) < 0.02
