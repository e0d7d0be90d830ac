# SPDX-License-Identifier: Apache-2.0
"""The colour picture beside a view, for the nodes that look at colour too."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from sensor_msgs.msg import CameraInfo

from tof_core.capture import Colour
from tof_core.decode import camera_from_info, decode_colour, stamp_ns
from tof_core.errors import DecodeError, TransformError
from tof_core.options import NOT_WANTED
from tof_core.topics import base_topic
from tof_ros import messages, qos

if TYPE_CHECKING:
    from tof_core.camera import Camera
    from tof_core.capture import View
    from tof_core.live import ColourViewOptions
    from tof_core.robot import RobotChain
    from tof_ros.base import RoomNode


class ColourFeed:
    """Keeps the newest colour image; a view gets it if it was taken during the view's dwell, or at most `colour_join_s` after it."""

    def __init__(self, node: RoomNode[Any], chain: RobotChain, options: ColourViewOptions) -> None:
        """Subscribe, unless the options turn colour off."""
        self._log = node.get_logger()
        self._chain, self._join_ns = chain, round(options.colour_join_s * 1e9)
        self._topic = options.colour_topic
        self._camera: Camera | None = None
        self._image: Any = None
        if self._topic != NOT_WANTED:
            info = options.colour_info_topic or f"{base_topic(self._topic).rpartition('/')[0]}/camera_info"
            node.input(self._topic, messages.image_class(self._topic), self._take, qos.sensor(depth=4))
            node.input(info, CameraInfo, lambda m: self._take_info(m, info), qos.sensor(depth=4))

    def _take(self, message: Any) -> None:
        self._image = message

    def _take_info(self, message: CameraInfo, where: str) -> None:
        self._camera = camera_from_info(message, where)

    def beside(self, view: View) -> View:
        """The view with its colour picture, or as it is where there is none."""
        message = self._image
        earliest = max(view.dwell_ns, view.stamp_ns - self._join_ns)
        if message is None or not earliest <= stamp_ns(message) <= view.stamp_ns + self._join_ns:
            return view
        try:
            image = decode_colour(message, self._topic)
        except DecodeError as error:
            self._log.warning(f"no colour: {error}", throttle_duration_sec=5.0)
            return view
        try:
            T = self._chain.transforms.lookup(view.camera.frame_id, message.header.frame_id, view.stamp_ns)
        except TransformError:
            T = None
        return replace(view, colour=Colour(image, self._camera, T, stamp_ns(message)))
