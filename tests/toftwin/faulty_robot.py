# SPDX-License-Identifier: Apache-2.0
"""A robot that sends what a test tells it to, stamp by stamp, and hears what the graph makes of it."""

from __future__ import annotations

import time
from collections import Counter
from typing import TYPE_CHECKING, Any

import numpy as np

from tests.tof_ros.peers import Observer, wait_for
from tof_core import decode
from tof_core.camera import Camera

if TYPE_CHECKING:
    from collections.abc import Iterable

    from tof_core.arrays import Float

PERIOD_NS = 66_000_000
CAMERA = Camera(64, 48, 60.0, 60.0, 31.5, 23.5, frame_id="hand_depth")
START_NS = 1_000_000_000_000


def before_the_section() -> Float:
    """T_cell_camera 0.9 m before the built-in section, looking at it."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = [[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]], [0.9, 0.0, 0.8]
    return T


class FaultyRobot:
    """Camera and TF in one node. Frame `n` is stamped START_NS + n PERIOD_NS; every frame has other noise."""

    def __init__(self, context: Any, namespace: str = "spot", name: str = "robot", *, metres: float = 0.0) -> None:
        from sensor_msgs.msg import CameraInfo, Image, TimeReference
        from tf2_msgs.msg import TFMessage

        from tof_ros import qos
        from tof_scene.builtin import make_builtin
        from tof_scene.raycast import Raycaster
        from tof_scene.render import render

        self.observer, self.namespace = Observer(context, name), namespace
        node = self.node = self.observer.node
        self.T = before_the_section()
        self._depth = render(Raycaster(make_builtin("body_section")), CAMERA, self.T).depth if not metres else np.full(CAMERA.shape, metres)
        self._rng = np.random.default_rng(0)
        self._image = node.create_publisher(Image, f"/{namespace}/depth/hand/image", qos.sensor(reliable=True, depth=64))
        self._info = node.create_publisher(CameraInfo, f"/{namespace}/depth/hand/camera_info", qos.sensor(reliable=True, depth=64))
        self._tf = node.create_publisher(TFMessage, "/tf", qos.TF)
        self._tf_static = node.create_publisher(TFMessage, "/tf_static", qos.TF_STATIC)
        self.done: dict[str, list[tuple[int, str]]] = {room: [] for room in ("preproc", "label", "infer")}
        for room in self.done:
            node.create_subscription(TimeReference, f"/{namespace}/{room}/done", lambda m, room=room: self._note(room, m), qos.RECORD)

    def _note(self, room: str, message: Any) -> None:
        self.done[room].append((decode.stamp_ns(message), message.source))

    def connect(self) -> None:
        """Wait until preproc hears images and TF, then say where the camera sits on the body."""
        from tf2_msgs.msg import TFMessage

        from tof_ros import messages

        wait_for(lambda: self._image.get_subscription_count() and self._info.get_subscription_count() and self._tf.get_subscription_count())
        self._tf_static.publish(TFMessage(transforms=[messages.transform(self._frame("body"), self._frame(CAMERA.frame_id), self.T)]))
        time.sleep(0.3)

    def _frame(self, name: str) -> str:
        return name if self.namespace == "spot" else f"{self.namespace}/{name}"

    def tf(self, first: float, last: float, *, shift_ns: int = 0) -> None:
        """TF at 50 Hz from a little before frame `first` to a little after frame `last`, as one message."""
        from tf2_msgs.msg import TFMessage

        from tof_ros import messages

        begin, end = (round(START_NS + n * PERIOD_NS) + shift_ns for n in (first, last))
        stamps = range(begin - 100_000_000, end + 140_000_000, 20_000_000)
        moved = [messages.transform("cell", self._frame("body"), np.eye(4), stamp) for stamp in stamps]
        self._tf.publish(TFMessage(transforms=moved))

    def stray_tf(self, n: float, shift_ns: int, child: str = "body") -> None:
        """One transform far from the time of frame `n`."""
        from tf2_msgs.msg import TFMessage

        from tof_ros import messages

        stamp = round(START_NS + n * PERIOD_NS) + shift_ns
        self._tf.publish(TFMessage(transforms=[messages.transform("cell", self._frame(child), np.eye(4), stamp)]))

    def frame(self, n: float, *, info: bool = True, twice: bool = False, shift_ns: int = 0, camera: Camera = CAMERA) -> int:
        """Publish frame `n`; gives its stamp."""
        from tof_ros import messages

        stamp = round(START_NS + n * PERIOD_NS) + shift_ns
        head = messages.header(stamp, self._frame(CAMERA.frame_id))
        depth = self._depth if camera.shape == CAMERA.shape else np.full(camera.shape, 0.9)
        noisy = np.nan_to_num(depth + self._rng.normal(0, 0.002, depth.shape), nan=0.0)
        image = messages.image(np.round(1000 * noisy).astype(np.uint16), "16UC1", head)
        if info:
            self._info.publish(messages.camera_info(camera, head))
        for _ in range(2 if twice else 1):
            self._image.publish(image)
        return stamp

    def frames(self, numbers: Iterable[float], **how: Any) -> list[int]:
        """Several frames with their TF."""
        numbers = list(numbers)
        self.tf(min(numbers), max(numbers), shift_ns=how.get("shift_ns", 0))
        return [self.frame(n, **how) for n in numbers]

    def paced(self, numbers: Iterable[float], seconds: float = 0.1, **how: Any) -> list[int]:
        """Several frames one after the other, each with its TF."""
        out = []
        for n in numbers:
            out += self.frames([n], **how)
            time.sleep(seconds)
        return out

    def fates(self, stamps: Iterable[int], room: str = "preproc", seconds: float = 20.0) -> Counter[str]:
        """What became of frames, once the room has answered each at least once."""
        wanted = set(stamps)
        wait_for(lambda: wanted <= {stamp for stamp, _ in self.done[room]}, seconds, f"for {room}: {self.done[room][-5:]}")
        return Counter(fate for stamp, fate in self.done[room] if stamp in wanted)
