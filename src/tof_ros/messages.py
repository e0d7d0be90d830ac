# SPDX-License-Identifier: Apache-2.0
"""Arrays to ROS messages; the way back is `tof_core.decode`, which reads rclpy's messages as it reads a bag's."""

from __future__ import annotations

from array import array
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Pose, PoseStamped, PoseWithCovarianceStamped, TransformStamped
from sensor_msgs.msg import CameraInfo, CompressedImage, Image, PointCloud2, PointField, RegionOfInterest, TimeReference
from std_msgs.msg import Header

from tof_core import compressed, encode, se3
from tof_core.topics import is_compressed

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from tof_core.arrays import Float
    from tof_core.camera import Camera


def image_class(topic: str) -> type[Any]:
    """The class of an image topic's messages: image_transport's names say which are compressed."""
    found: type[Any] = CompressedImage if is_compressed(topic) else Image
    return found


def to_stamp(stamp_ns: int) -> Time:
    """A stamp of nanoseconds."""
    return Time(sec=stamp_ns // 1_000_000_000, nanosec=stamp_ns % 1_000_000_000)


def header(stamp_ns: int, frame_id: str) -> Header:
    """A header."""
    return Header(stamp=to_stamp(stamp_ns), frame_id=frame_id)


def buffer(data: bytes | NDArray[Any]) -> array[int]:
    """Bytes in the one form that rclpy takes without looking at each."""
    out = array("B")
    out.frombytes(data if isinstance(data, bytes) else np.ascontiguousarray(data).data.cast("B"))
    return out


def image(values: NDArray[Any], encoding: str, head: Header) -> Image:
    """An array (H, W) as a `sensor_msgs/Image`."""
    fields = encode.image_fields(values, encoding)
    return Image(header=head, **{**fields, "data": buffer(fields["data"])})


def packed_depth(depth: NDArray[np.float32], head: Header, code: str = "png") -> CompressedImage:
    """Metres (H, W) as a `sensor_msgs/CompressedImage` of compressedDepth (PNG or RVL): 0.1 mm a count at 1 m, up to 10 m."""
    data, kind = compressed.packed_depth(depth, code)
    return CompressedImage(header=head, format=kind, data=buffer(data))


def camera_info(camera: Camera, head: Header) -> CameraInfo:
    """A camera as a `sensor_msgs/CameraInfo`."""
    return CameraInfo(header=head, roi=RegionOfInterest(), **_camera_fields(camera))


@lru_cache(maxsize=16)
def _camera_fields(camera: Camera) -> dict[str, Any]:
    """The same for every frame of a camera."""
    fields = encode.camera_info_fields(camera)
    return {**fields, "d": fields["d"].tolist()}


def points(xyz: NDArray[Any], head: Header, intensity: NDArray[Any] | None = None) -> PointCloud2:
    """Points (H, W, 3) in metres as an organised `sensor_msgs/PointCloud2`, with their intensity (H, W) where there is one."""
    fields = encode.points_fields(xyz, intensity)
    named = [PointField(name=f.name, offset=f.offset, datatype=f.datatype, count=f.count) for f in fields["fields"]]
    return PointCloud2(header=head, **{**fields, "fields": named, "data": buffer(fields["data"])})


def pose(T: Float, cov: Float, head: Header) -> PoseWithCovarianceStamped:
    """A pose (4, 4) in the frame of the header, with its covariance (6, 6) of (x, y, z, rotX, rotY, rotZ; fixed axes)."""
    out = PoseWithCovarianceStamped(header=head)
    set_pose(out.pose.pose, T)
    out.pose.covariance = cov.reshape(-1)
    return out


def pose_stamped(T: Float, head: Header) -> PoseStamped:
    """A pose (4, 4) in the frame of the header."""
    out = PoseStamped(header=head)
    set_pose(out.pose, T)
    return out


def matrix(message: Pose) -> Float:
    """The transform (4, 4) of a `geometry_msgs/Pose`."""
    p, q = message.position, message.orientation
    return se3.from_quat((p.x, p.y, p.z), (q.x, q.y, q.z, q.w))


def set_pose(message: Any, T: Float) -> None:
    """Write a transform (4, 4) into a `geometry_msgs/Pose`."""
    x, y, z, w = (float(v) for v in se3.quat_from_matrix(T[:3, :3]))
    message.position.x, message.position.y, message.position.z = (float(v) for v in T[:3, 3])
    message.orientation.x, message.orientation.y, message.orientation.z, message.orientation.w = x, y, z, w


def transform(parent: str, child: str, T: Float, stamp_ns: int = 0) -> TransformStamped:
    """A `geometry_msgs/TransformStamped` of `T_parent_child`."""
    out = TransformStamped(header=header(stamp_ns, parent), child_frame_id=child)
    move, turn = out.transform.translation, out.transform.rotation
    move.x, move.y, move.z = (float(v) for v in T[:3, 3])
    turn.x, turn.y, turn.z, turn.w = (float(v) for v in se3.quat_from_matrix(T[:3, :3]))
    return out


def time_reference(stamp_ns: int, reference_ns: int, source: str, frame_id: str = "") -> TimeReference:
    """A `sensor_msgs/TimeReference`: a stamp that refers to another one, with a word about it."""
    return TimeReference(header=header(stamp_ns, frame_id), time_ref=to_stamp(reference_ns), source=source)
