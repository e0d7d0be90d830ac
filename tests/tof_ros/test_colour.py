# SPDX-License-Identifier: Apache-2.0
"""Colour beside a view: from a raw topic or from image_transport's compressed one; a damaged picture costs the picture alone."""

from __future__ import annotations

from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from tof_core import se3
from tof_core.camera import Camera
from tof_core.capture import Capture, View
from tof_core.live import ColourViewOptions
from tof_core.robot import RobotChain
from tof_core.tf import TransformBuffer

pytest.importorskip("rclpy", reason="no ROS 2 here")
from tests.tof_core import packing

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

CAMERA = Camera(8, 6, 10.0, 10.0, 3.5, 2.5, frame_id="hand_depth_sensor")
COLOUR = Camera(16, 12, 20.0, 20.0, 7.5, 5.5, frame_id="hand_color_sensor")
BESIDE = se3.exp([0.02, 0.0, 0.0, 0.0, 0.0, 0.0])
STAMP = 1_000_000_000


class Heard:
    """A node's subscriptions, by topic: the class of the message and who takes it."""

    def __init__(self) -> None:
        self.topics: dict[str, tuple[type[Any], Callable[[Any], None]]] = {}
        self.warnings: list[str] = []

    def input(self, topic: str, kind: type[Any], take: Callable[[Any], None], profile: Any) -> None:
        del profile
        self.topics[topic] = kind, take

    def get_logger(self) -> Any:
        return SimpleNamespace(warning=lambda text, **_: self.warnings.append(text))


def picture() -> NDArray[np.uint8]:
    """(H, W, 3) in the order blue, green, red: the left half red, the right half blue."""
    bgr = np.zeros((*COLOUR.shape, 3), np.uint8)
    bgr[:, :8, 2], bgr[:, 8:, 0] = 210, 90
    return bgr


def feed(node: Heard, topic: str) -> Any:
    from tof_ros.colour import ColourFeed

    transforms = TransformBuffer()
    transforms.add(CAMERA.frame_id, COLOUR.frame_id, 0, BESIDE, static=True)
    options: Any = ColourViewOptions(colour_topic=topic)
    return ColourFeed(node, RobotChain(transforms, "cell"), options)  # type: ignore[arg-type]


def view() -> View:
    return View.of_capture(Capture(STAMP, CAMERA, np.ones(CAMERA.shape, np.float32), np.zeros(CAMERA.shape, np.uint8)))


def test_a_compressed_picture_is_heard_by_its_name_and_has_the_raw_one_s_camera_info() -> None:
    from sensor_msgs.msg import CameraInfo, CompressedImage

    from tof_ros import messages

    node = Heard()
    colour = feed(node, "camera/hand/image/compressed")
    assert {topic: kind for topic, (kind, _) in node.topics.items()} == {
        "camera/hand/image/compressed": CompressedImage,
        "camera/hand/camera_info": CameraInfo,
    }
    head = messages.header(STAMP, COLOUR.frame_id)
    node.topics["camera/hand/camera_info"][1](messages.camera_info(COLOUR, head))
    data = messages.buffer(packing.png(picture()))
    node.topics["camera/hand/image/compressed"][1](CompressedImage(header=head, format="rgb8; png compressed bgr8", data=data))
    found = colour.beside(view()).colour
    assert found is not None
    assert found.image[3, 2].tolist() == [210, 0, 0]
    assert found.image[3, 12].tolist() == [0, 0, 90]
    assert found.camera == COLOUR
    np.testing.assert_allclose(found.T_camera_colour, BESIDE, atol=1e-12)


def test_a_damaged_picture_leaves_the_view_without_colour_and_is_said() -> None:
    from sensor_msgs.msg import CompressedImage

    from tof_ros import messages

    node = Heard()
    colour = feed(node, "camera/hand/image/compressed")
    data = messages.buffer(packing.png(picture())[:40])
    message = CompressedImage(header=messages.header(STAMP, COLOUR.frame_id), format="rgb8; png compressed bgr8", data=data)
    node.topics["camera/hand/image/compressed"][1](message)
    assert colour.beside(view()).colour is None
    assert len(node.warnings) == 1
    assert node.warnings[0].startswith("no colour: camera/hand/image/compressed: ")


@pytest.mark.parametrize(("late_ns", "taken"), [(0, True), (40_000_000, True), (2_000_000_000, False), (-1, False)])
def test_a_picture_of_another_moment_is_not_taken(late_ns: int, taken: bool) -> None:  # noqa: FBT001
    from tof_ros import messages

    node = Heard()
    colour = feed(node, "camera/hand/image")
    node.topics["camera/hand/image"][1](messages.image(picture(), "bgr8", messages.header(STAMP + late_ns, COLOUR.frame_id)))
    found = colour.beside(view()).colour
    assert (found is not None) == taken
    assert found is None or found.stamp_ns == STAMP + late_ns
