# SPDX-License-Identifier: Apache-2.0
"""Arrays to the fields of ROS messages: used by the bag writer and by the nodes alike."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from tof_core.errors import DecodeError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from tof_core.arrays import Image
    from tof_core.camera import Camera


class Encoding(NamedTuple):
    """What one pixel of an image encoding is: element type (without byte order) and channels."""

    element: str
    channels: int


ENCODINGS = {
    "16UC1": Encoding("u2", 1),
    "mono16": Encoding("u2", 1),
    "32FC1": Encoding("f4", 1),
    "32FC3": Encoding("f4", 3),
    "32FC4": Encoding("f4", 4),
    "mono8": Encoding("u1", 1),
    "8UC1": Encoding("u1", 1),
    "16SC1": Encoding("i2", 1),
    "rgb8": Encoding("u1", 3),
    "bgr8": Encoding("u1", 3),
    "rgba8": Encoding("u1", 4),
    "bgra8": Encoding("u1", 4),
}
"""The encodings of `sensor_msgs/Image` that are read and written."""


def image_fields(array: NDArray[Any], encoding: str, *, step: int = 0, bigendian: bool = False) -> dict[str, Any]:
    """Fields of a `sensor_msgs/Image` but its header, of an array (H, W) or (H, W, channels).

    The array's type must be the encoding's own (uint16 for 16UC1; see `depth_counts`). `step`
    pads the rows to so many bytes. The data are one contiguous uint8 array.
    """
    kind = encoding_of(encoding)
    array = np.asarray(array)
    expected = array.shape[:2] if kind.channels == 1 else (*array.shape[:2], kind.channels)
    if array.dtype.kind + str(array.dtype.itemsize) != kind.element or array.shape != expected:
        msg = f"{encoding} takes ({kind.element}, {kind.channels} channels), not {array.dtype} of shape {array.shape}"
        raise DecodeError(msg, todo="convert first (depth_counts for 16UC1 depth)")
    height, width = array.shape[:2]
    rows = np.ascontiguousarray(array, dtype=f"{'>' if bigendian else '<'}{kind.element}").view(np.uint8).reshape(height, -1)
    if step > rows.shape[1]:
        rows = np.pad(rows, ((0, 0), (0, step - rows.shape[1])))
    return {
        "height": height,
        "width": width,
        "encoding": encoding,
        "is_bigendian": int(bigendian),
        "step": rows.shape[1],
        "data": rows.reshape(-1),
    }


def encoding_of(name: str, where: str = "") -> Encoding:
    """Element type and channels of an encoding; a DecodeError lists the known ones."""
    try:
        return ENCODINGS[name]
    except KeyError:
        msg = f"encoding '{name}' is not known"
        raise DecodeError(msg, where=where, todo=f"publish one of {', '.join(ENCODINGS)}") from None


def depth_counts(depth: Image, scale: float = 0.001) -> NDArray[np.uint16]:
    """Metres (H, W) as 16UC1 counts of `scale` metres; NaN becomes 0, too large a depth 65535."""
    with np.errstate(invalid="ignore"):
        counts = np.rint(np.nan_to_num(np.asarray(depth, np.float64), nan=0.0, posinf=65.535 / scale, neginf=0.0) / scale)
    return np.asarray(np.clip(counts, 0, 65535), np.uint16)


def camera_info_fields(camera: Camera) -> dict[str, Any]:
    """Fields of a `sensor_msgs/CameraInfo` but its header, its binning and its ROI (both zero)."""
    model = camera.distortion_model or "plumb_bob"
    length = 8 if model == "rational_polynomial" else 5
    d = np.zeros(max(length, len(camera.distortion)))
    d[: len(camera.distortion)] = camera.distortion
    return {
        "height": camera.height,
        "width": camera.width,
        "distortion_model": model,
        "d": d,
        "k": camera.K.reshape(-1),
        "r": np.eye(3).reshape(-1),
        "p": np.hstack([camera.K, np.zeros((3, 1))]).reshape(-1),
        "binning_x": 0,
        "binning_y": 0,
    }


@dataclass(frozen=True, slots=True)
class PointField:
    """One field of a PointCloud2: its name, byte offset and datatype code (7 is float32)."""

    name: str
    offset: int
    datatype: int = 7
    count: int = 1


def points_fields(points: ArrayLike, intensity: Image | None = None) -> dict[str, Any]:
    """Fields of a `sensor_msgs/PointCloud2` but its header, of points (N, 3) or organised (H, W, 3).

    float32 x, y, z and, where given, intensity of the same leading shape. `fields` holds
    `PointField` tuples; the caller makes messages of them.
    """
    xyz = np.asarray(points, np.float32)
    grid = xyz if xyz.ndim == 3 else xyz[None]
    parts = [grid] if intensity is None else [grid, np.asarray(intensity, np.float32).reshape(*grid.shape[:2], 1)]
    cloud = np.ascontiguousarray(np.concatenate(parts, axis=-1), dtype="<f4")
    names = ("x", "y", "z") if intensity is None else ("x", "y", "z", "intensity")
    height, width, count = cloud.shape
    return {
        "height": height,
        "width": width,
        "fields": [PointField(name, 4 * i) for i, name in enumerate(names)],
        "is_bigendian": False,
        "point_step": 4 * count,
        "row_step": 4 * count * width,
        "data": cloud.view(np.uint8).reshape(-1),
        "is_dense": bool(np.isfinite(cloud).all()),
    }
