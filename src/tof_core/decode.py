# SPDX-License-Identifier: Apache-2.0
"""ROS messages to arrays: encoding, row step and byte order honoured.

Messages are duck-typed: those of rosbags and of rclpy both work. Depth stays as stored
(z, or radial from some cameras), in metres.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from tof_core.bounds import LARGEST_RASTER
from tof_core.camera import Camera
from tof_core.clouds import depth_from_points as depth_from_points  # noqa: PLC0414 (one place to decode from)
from tof_core.compressed import size_of, unpacked
from tof_core.encode import encoding_of
from tof_core.errors import CameraError, DecodeError
from tof_core.reasons import Reason

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from tof_core.arrays import Bytes, Image

DEPTH_ENCODINGS = ("16UC1", "mono16", "32FC1")
AMPLITUDE_ENCODINGS = ("mono8", "8UC1", "mono16", "16UC1", "32FC1")
COLOUR_ENCODINGS = ("rgb8", "bgr8", "rgba8", "bgra8", "mono8", "8UC1")


def stamp_ns(msg: Any) -> int:
    """Nanoseconds of a message's header stamp."""
    return time_ns(msg.header.stamp)


def time_ns(stamp: Any) -> int:
    """Nanoseconds of a `builtin_interfaces/Time`."""
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def image_size(msg: Any, where: str = "") -> tuple[int, int]:
    """Height and width of a `sensor_msgs/Image`, or of a `CompressedImage` by its headers."""
    return (int(msg.height), int(msg.width)) if hasattr(msg, "encoding") else size_of(msg, where)


def pixels(msg: Any, where: str = "") -> NDArray[Any]:
    """The raster of an image in its own type: (H, W) or (H, W, channels), a view where possible."""
    return _raster(msg, where)[0]


def _raster(msg: Any, where: str) -> tuple[NDArray[Any], str]:
    """The raster of a `sensor_msgs/Image` or `CompressedImage`, and its encoding."""
    if hasattr(msg, "encoding"):
        return _raw(msg, where), str(msg.encoding)
    if hasattr(msg, "format"):
        return unpacked(msg, where)
    raise DecodeError("is no sensor_msgs/Image", where=where, todo="name the image topic")


def _raw(msg: Any, where: str) -> NDArray[Any]:
    kind = encoding_of(msg.encoding, where)
    dtype = np.dtype(f"{'>' if msg.is_bigendian else '<'}{kind.element}")
    height, width, step = int(msg.height), int(msg.width), int(msg.step)
    row = width * kind.channels * dtype.itemsize
    data = _buffer(msg.data)
    if step < row or data.size < (height - 1) * step + row or not height * width:
        what = f"{width}x{height} {msg.encoding} with step {step} does not fit its {data.size} bytes"
        raise DecodeError(what, where=where, todo="the publisher must send whole rows")
    if step == row:
        raster = data[: height * row].view(dtype).reshape(height, width, kind.channels)
    else:
        raster = np.lib.stride_tricks.as_strided(data, (height, row), (step, 1)).view(dtype).reshape(height, width, kind.channels)
    return raster[..., 0] if kind.channels == 1 else raster


def _buffer(data: Any) -> Bytes:
    """Any message's `data` as uint8 without a copy (array.array, bytes, ndarray; lists are copied)."""
    try:
        return np.frombuffer(data, np.uint8)
    except (TypeError, BufferError, ValueError):
        return np.asarray(data, np.uint8).reshape(-1)


def decode_depth(msg: Any, where: str = "", *, scale: float = 0.001) -> tuple[Image, Bytes]:
    """Depth (H, W) in metres, NaN invalid, and the reason map (H, W).

    Raw or compressed. Integer images: `scale` metres a count (REP 118: 1 mm); 0 is no return, 65535 saturated.
    32FC1: NaN, +inf (REP 117: nothing seen) and depths from `NOTHING_M` on are no return, -inf is out of range (too close).
    REP 118 allows 0.0 as a depth of zero. No camera measures that, and publishers write 0.0 for
    "no depth", so it counts as no return. A negative depth is out of range.
    """
    raster, encoding = _raster(msg, where)
    if encoding not in DEPTH_ENCODINGS:
        what = f"encoding '{encoding}' holds no depth"
        raise DecodeError(what, where=where, todo=f"use a topic with {', '.join(DEPTH_ENCODINGS)}")
    return depth_of_counts(raster, scale) if raster.dtype.kind == "u" else _float_depth(raster)


NOTHING_M = 1e6
"""Metres from which depth stands for "nothing there": renderers write 1e10 for it (Blender), and no depth is so large, in millimetres either."""


def depth_of_counts(raster: NDArray[Any], scale: float = 0.001) -> tuple[Image, Bytes]:
    """Depth (H, W) in metres and reason map (H, W) of unsigned counts of `scale` metres each; 0 is no return, 65535 saturated."""
    metres, reasons = _count_tables(scale)
    # Every index exists: mode "clip" skips the check of each, two thirds of the time.
    return metres.take(raster, mode="clip"), reasons.take(raster, mode="clip")


@lru_cache(maxsize=4)
def _count_tables(scale: float) -> tuple[Image, Bytes]:
    """Metres and reason of each of the 65536 counts: one look-up replaces four passes."""
    metres = (np.arange(65536) * scale).astype(np.float32)
    reasons = np.zeros(65536, np.uint8)
    metres[[0, 65535]] = np.nan
    reasons[0], reasons[65535] = Reason.NO_RETURN, Reason.SATURATED
    return metres, reasons


def _float_depth(raster: NDArray[Any]) -> tuple[Image, Bytes]:
    depth = raster.astype(np.float32)
    reason = np.zeros(depth.shape, np.uint8)
    valid = (depth > 0) & (depth < NOTHING_M)
    if not valid.all():
        reason[~valid] = Reason.NO_RETURN
        reason[depth < 0] = Reason.OUT_OF_RANGE
        depth[~valid] = np.nan
    return depth, reason


def decode_amplitude(msg: Any, where: str = "") -> Image:
    """Amplitude or infrared (H, W) float32 in the camera's own counts."""
    raster, encoding = _raster(msg, where)
    if encoding not in AMPLITUDE_ENCODINGS:
        what = f"encoding '{encoding}' holds no amplitude"
        raise DecodeError(what, where=where, todo=f"use a topic with {', '.join(AMPLITUDE_ENCODINGS)}")
    return raster.astype(np.float32)


def decode_colour(msg: Any, where: str = "") -> Bytes:
    """Colour (H, W, 3) uint8 RGB; grey images give three equal channels, alpha is dropped."""
    raster, encoding = _raster(msg, where)
    if encoding not in COLOUR_ENCODINGS:
        what = f"encoding '{encoding}' holds no colour"
        raise DecodeError(what, where=where, todo=f"use a topic with {', '.join(COLOUR_ENCODINGS)}")
    if raster.ndim == 2:
        return np.repeat(raster[..., None], 3, axis=-1)
    order = [2, 1, 0] if encoding.startswith("bgr") else [0, 1, 2]
    return np.ascontiguousarray(raster[..., order])


def camera_from_info(msg: Any, where: str = "camera_info", *, rectified: bool = False) -> Camera:
    """The camera of the published raster: K after ROI and binning; P and no distortion where `rectified`.

    The centre of a binned pixel lies between the centres of its pixels: u' = (u + 1/2) / b - 1/2.
    """
    k, p = [float(x) for x in msg.k], [float(x) for x in msg.p]
    fx, skew, cx, fy, cy = (p[0], p[1], p[2], p[5], p[6]) if rectified else (k[0], k[1], k[2], k[4], k[5])
    if fx and abs(skew) > 1e-6 * abs(fx):
        what = f"K has a skew of {skew:g}, which no known model has"
        raise CameraError(what, where=where)
    bx, by = max(int(msg.binning_x), 1), max(int(msg.binning_y), 1)
    roi = msg.roi
    x0, y0 = int(roi.x_offset), int(roi.y_offset)
    width, height = int(roi.width) or int(msg.width) - x0, int(roi.height) or int(msg.height) - y0
    if width * height > LARGEST_RASTER:
        what = f"states {width}x{height} pixels"
        raise CameraError(what, where=where, todo=f"up to {LARGEST_RASTER} are read; is the message damaged?")
    try:
        return Camera(
            width=width // bx,
            height=height // by,
            fx=fx / bx,
            fy=fy / by,
            cx=(cx - x0 + 0.5) / bx - 0.5,
            cy=(cy - y0 + 0.5) / by - 0.5,
            distortion_model=str(msg.distortion_model),
            frame_id=str(msg.header.frame_id),
            distortion=() if rectified or not any(msg.d) else tuple(float(x) for x in msg.d),
        )
    except CameraError as error:
        raise CameraError(error.what, where=where, todo=error.todo) from None


def check_size(shape: tuple[int, ...], camera: Camera, where: str) -> None:
    """Refuse an image (H, W) whose size is not CameraInfo's."""
    if shape[:2] != camera.shape:
        what = f"image is {shape[1]}x{shape[0]} but its camera_info says {camera.width}x{camera.height}"
        raise CameraError(what, where=where, todo="publish the camera_info of this raster, or name it with --info-topic")
