# SPDX-License-Identifier: Apache-2.0
"""Peers whose QoS does not fit ours are named, with topic and policy, as long as they are there."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from tests.tof_ros.peers import Observer, wait_for

pytest.importorskip("rclpy", reason="no ROS 2 here")

if TYPE_CHECKING:
    from collections.abc import Iterator

pytestmark = pytest.mark.dds


@pytest.fixture(scope="module")
def observer(ros_domain: int) -> Iterator[Observer]:
    from tof_preproc.node import make_node
    from tof_ros.environment import parameter_overrides, ros_context
    from tof_ros.spin import spinning

    with ros_context(domain=ros_domain) as context:
        node = make_node(context=context, namespace="spot", parameter_overrides=parameter_overrides({"live.reliable": True}))
        observer = Observer(context)
        with spinning([node, observer.node]):
            wait_for(lambda: observer.node.count_subscribers("/spot/depth/hand/image"))
            yield observer


def test_a_best_effort_camera_that_a_reliable_node_cannot_hear_is_named(observer: Observer) -> None:
    from sensor_msgs.msg import Image

    from tof_ros import qos

    camera = observer.node.create_publisher(Image, "/spot/depth/hand/image", qos.sensor())
    message = observer.status("spot/preproc", lambda s: "QoS of" in s.message).message
    assert "QoS of /spot/depth/hand/image: /observer offers another reliability" in message
    assert "live.reliable:=false" in message
    wait_for(lambda: any("offers another reliability" in line for line in observer.log))
    observer.node.destroy_publisher(camera)
    observer.status("spot/preproc", lambda s: "QoS of" not in s.message)


def test_a_listener_that_wants_latched_results_is_named(observer: Observer) -> None:
    from sensor_msgs.msg import Image

    from tof_ros import qos

    ears = observer.node.create_subscription(Image, "/spot/preproc/depth", lambda _: None, qos.LATCHED)
    message = observer.status("spot/preproc", lambda s: "QoS of" in s.message).message
    assert "QoS of /spot/preproc/depth: /observer asks for another durability" in message
    observer.node.destroy_subscription(ears)
    observer.status("spot/preproc", lambda s: "QoS of" not in s.message)


@pytest.mark.parametrize(("policy", "parameter"), [("reliability", False), ("durability", True)])
def test_the_parameter_is_named_only_where_there_is_one_that_helps(observer: Observer, policy: str, *, parameter: bool) -> None:
    import rclpy
    from sensor_msgs.msg import Image

    from tof_ros import qos
    from tof_ros.mismatch import Mismatches
    from tof_ros.spin import spinning

    node, topic = rclpy.create_node("ears", context=observer.node.context), f"/{policy}"
    if parameter:
        node.declare_parameter("live.reliable", value=True)
    mismatches = Mismatches(node)
    observer.node.create_publisher(Image, topic, qos.sensor(reliable=policy == "durability"))
    asked = qos.OUTPUT if policy == "reliability" else qos.LATCHED
    node.create_subscription(Image, topic, lambda _: None, asked, event_callbacks=mismatches.of_subscription(topic))
    with spinning([node]):
        (line,) = wait_for(mismatches.current)
        assert line.endswith(f"nothing of it is heard; set qos_overrides.{topic}.subscription.{policy}")
