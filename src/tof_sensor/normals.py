# SPDX-License-Identifier: Apache-2.0
"""Images of surface normals that a simulator publishes beside its depth."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from tof_core.decode import check_size, pixels
from tof_core.errors import DecodeError
from tof_core.joined import Joined

if TYPE_CHECKING:
    from tof_core.arrays import Image
    from tof_core.capture import Capture

NORMALS_KIND = "sensor_msgs/msg/Image"
ENCODINGS = ("32FC3", "32FC4")
"""Three floats a pixel, unit length, in the axes of the camera's optical frame; a fourth is not read."""


class Normals:
    """Images of normals waiting for the depth image of their stamp."""

    def __init__(self, join_s: float) -> None:
        """Stamps may differ by `join_s` seconds."""
        self._joined, self._within_ns = Joined([], []), round(join_s * 1e9)

    def put(self, message: Any) -> None:
        """Add an image of normals."""
        self._joined.put(message)

    def settled(self, stamp_ns: int) -> bool:
        """Whether no later message can belong to a stamp."""
        return self._joined.settled(stamp_ns)

    def at(self, capture: Capture) -> Image | None:
        """(H, W, 3) normals of a capture, None if none were received.

        Raises:
            DecodeError: the image is of another encoding or size.
        """
        self._joined.forget_before(capture.stamp_ns - self._within_ns)
        message = self._joined.nearest(capture.stamp_ns, self._within_ns)
        if message is None:
            return None
        if message.encoding not in ENCODINGS:
            raise DecodeError(f"encoding '{message.encoding}' holds no normals", where="normals", todo=f"publish {ENCODINGS[0]}")
        raster = pixels(message, "normals")
        check_size(raster.shape, capture.camera, "normals")
        return np.asarray(raster[..., :3], np.float32)

    def clear(self) -> None:
        """Drop waiting images."""
        self._joined = Joined([], [])
