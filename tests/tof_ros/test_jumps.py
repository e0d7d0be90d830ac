# SPDX-License-Identifier: Apache-2.0
"""A simulated clock that is set back, as `ros2 bag play --loop` does: one reset, and an end on `done` for every frame."""

from __future__ import annotations

import gc
import time
from collections import Counter
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from tof_core.camera import Camera
from tof_core.decode import stamp_ns

pytest.importorskip("rclpy", reason="no ROS 2 here")
from tests.tof_ros.peers import Observer, wait_for

if TYPE_CHECKING:
    from collections.abc import Iterator

pytestmark = pytest.mark.dds
CAMERA = Camera(32, 24, 30.0, 30.0, 15.5, 11.5, frame_id="hand_depth_sensor")
START, RATE_NS = 1_700_000_000_000_000_000, 66_000_000


class Loop:
    """A `preproc` and an `infer` on simulated time, and a bag that plays again and again."""

    def __init__(self, observer: Observer) -> None:
        from rosgraph_msgs.msg import Clock
        from sensor_msgs.msg import CameraInfo, Image, TimeReference

        from tof_ros import qos

        node = observer.node
        self.observer = observer
        self.done: dict[str, list[tuple[int, str]]] = {"preproc": [], "infer": []}
        for room, ends in self.done.items():
            node.create_subscription(TimeReference, f"{room}/done", partial(self._ended, ends), qos.OUTPUT)
        self._clock = node.create_publisher(Clock, "/clock", qos.sensor(reliable=True))
        self._depth = node.create_publisher(Image, "depth/hand/image", qos.sensor(reliable=True))
        self._info = node.create_publisher(CameraInfo, "depth/hand/camera_info", qos.sensor(reliable=True))

    @staticmethod
    def _ended(ends: list[tuple[int, str]], message: Any) -> None:
        ends.append((stamp_ns(message), message.source))

    @property
    def connected(self) -> bool:
        return all(p.get_subscription_count() >= 2 for p in (self._clock, self._depth, self._info))

    def clock(self, number: int) -> None:
        """Simulated time of a frame."""
        from rosgraph_msgs.msg import Clock

        from tof_ros import messages

        self._clock.publish(Clock(clock=messages.to_stamp(START + number * RATE_NS)))
        time.sleep(0.05)

    def frame(self, number: int, turn: int) -> int:
        """Send a frame; each turn's has other pixels. Its stamp."""
        from tof_ros import messages

        stamp = START + number * RATE_NS
        head = messages.header(stamp, CAMERA.frame_id)
        counts = np.full(CAMERA.shape, 800 + 10 * turn + number % 7, np.uint16)
        self._info.publish(messages.camera_info(CAMERA, head))
        self._depth.publish(messages.image(counts, "16UC1", head))
        time.sleep(0.03)
        return stamp


def complete(ends: list[tuple[int, str]], count: int) -> bool:
    return len(ends) >= count


@pytest.fixture
def loop(ros_domain: int) -> Iterator[Loop]:
    from tof_infer.node import make_node as make_infer
    from tof_preproc.node import make_node
    from tof_ros.environment import parameter_overrides, ros_context
    from tof_ros.spin import spinning

    # rcl ends the log of a node's name with the node's last reference: an earlier test's node of that name must be gone by now.
    gc.collect()
    values = {"use_sim_time": True, "live.reliable": True}
    with ros_context(domain=ros_domain) as context:
        preproc = make_node(context=context, parameter_overrides=parameter_overrides({**values, "live.need_tf": False}))
        infer = make_infer(context=context, parameter_overrides=parameter_overrides(values))
        observer = Observer(context)
        with spinning([preproc, infer, observer.node]):
            loop = Loop(observer)
            wait_for(lambda: infer.active and loop.connected)
            yield loop


def said(observer: Observer, text: str) -> bool:
    return any(text in line for line in observer.log)


@pytest.mark.parametrize("first", ["the clock", "the stamps"])
def test_a_looping_bag_resets_once_and_every_frame_has_its_end(loop: Loop, first: str) -> None:
    loop.clock(0)
    sent = [loop.frame(n, 0) for n in range(40)]
    wait_for(lambda: all(len(ends) >= 40 for ends in loop.done.values()), what=str({k: len(v) for k, v in loop.done.items()}))
    loop.clock(40)
    if first == "the clock":  # frames of before are still in the queues
        loop.clock(0)
        sent += [loop.frame(n, 0) for n in range(40, 43)]
        sent += [loop.frame(n, 1) for n in range(20)]
    else:  # frames of after arrive before the clock
        sent += [loop.frame(n, 1) for n in range(4)]
        loop.clock(4)
        sent += [loop.frame(n, 1) for n in range(4, 20)]
    for room, ends in loop.done.items():
        wait_for(partial(complete, ends, len(sent)), what=f"{room}: {len(ends)} of {len(sent)}")
        assert Counter(stamp for stamp, _ in ends) == Counter(sent), room
    for name in ("preproc", "infer"):
        wait_for(partial(said, loop.observer, f"{name}: the clock was set back"), 10.0, f"for {name}'s log")
    time.sleep(0.5)
    for name in ("preproc", "infer"):
        assert sum(f"{name}: the clock was set back" in line for line in loop.observer.log) == 1, loop.observer.log
    kept = Counter(fate for _, fate in loop.done["preproc"])
    assert kept["kept"] >= 40 + 16
