# SPDX-License-Identifier: Apache-2.0
"""Bags out: rosbag2 in MCAP or sqlite3, with Humble's or Jazzy's types.

Frames are written through to the disk at least every `FLUSH_BYTES`: if the process is killed,
`open_bag` reads all messages up to the last such write.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Self

import numpy as np

from tof_core import se3
from tof_core.bag_yaml import use_libyaml
from tof_core.encode import camera_info_fields, image_fields, points_fields
from tof_core.errors import BagError, UsageError
from tof_core.typestores import TYPE_VERSIONS, typestore_of

if TYPE_CHECKING:
    from collections.abc import Iterable
    from types import TracebackType

    from numpy.typing import ArrayLike, NDArray
    from rosbags.interfaces import Qos
    from rosbags.rosbag2 import Writer

    from tof_core.arrays import Float, Image
    from tof_core.camera import Camera

FLUSH_BYTES = 200_000
"""Bytes after which data are written through to the disk: about one frame of 400x300 pixels."""


class BagWriter:
    """Writes one bag; use it as a context manager.

    Args:
        path: the folder to make; it must not exist.
        storage: "mcap" or "sqlite3".
        distro: ROS distribution whose message definitions are written: "jazzy" or "humble".
    """

    def __init__(
        self,
        path: Path | str,
        storage: Literal["mcap", "sqlite3"] = "mcap",
        distro: Literal["jazzy", "humble"] = "jazzy",
    ) -> None:
        """Check the call; nothing is written before `with`."""
        if storage not in ("mcap", "sqlite3"):
            raise UsageError(f"storage '{storage}' is not known", todo="use mcap or sqlite3")
        self.path = Path(path)
        self._storage, self._distro = storage, distro
        self._types = typestore_of(distro)
        self._writer: Writer | None = None
        self._connections: dict[str, Any] = {}
        self._unflushed = 0
        self.count = 0

    def __enter__(self) -> Self:
        """Make the folder and open the file."""
        from rosbags.rosbag2 import StoragePlugin, Writer, WriterError

        use_libyaml()
        plugin = StoragePlugin.MCAP if self._storage == "mcap" else StoragePlugin.SQLITE3
        try:
            self._writer = Writer(self.path, version=TYPE_VERSIONS[self._distro], storage_plugin=plugin)
            self._writer.open()
        except WriterError:
            raise BagError("exists already", where=self.path, todo="name another folder or remove it") from None
        except OSError as error:
            raise BagError(f"cannot be made: {error.strerror}", where=self.path) from None
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        """Finish the bag, also after an error: messages written so far stay readable."""
        if self._writer is None:
            return
        try:
            self._guarded(self._writer.close)
        except BagError:
            if kind is None:
                raise
        finally:
            self._writer = None

    def image(self, topic: str, array: NDArray[Any], encoding: str, frame_id: str, stamp_ns: int) -> None:
        """A `sensor_msgs/Image`; the array has the encoding's own type (`encode.depth_counts` for 16UC1 depth)."""
        fields = image_fields(array, encoding)
        self._message(topic, "sensor_msgs/msg/Image", stamp_ns, header=self._header(stamp_ns, frame_id), **fields)

    def camera_info(self, topic: str, camera: Camera, stamp_ns: int, frame_id: str = "") -> None:
        """A `sensor_msgs/CameraInfo` in the camera's own frame, or in `frame_id`."""
        roi = self._new("sensor_msgs/msg/RegionOfInterest", x_offset=0, y_offset=0, height=0, width=0, do_rectify=False)
        self._message(
            topic,
            "sensor_msgs/msg/CameraInfo",
            stamp_ns,
            header=self._header(stamp_ns, frame_id or camera.frame_id),
            roi=roi,
            **camera_info_fields(camera),
        )

    def points(self, topic: str, points: ArrayLike, frame_id: str, stamp_ns: int, intensity: Image | None = None) -> None:
        """A `sensor_msgs/PointCloud2` of points (N, 3) or organised (H, W, 3), metres."""
        fields = points_fields(points, intensity)
        fields["fields"] = [self._new("sensor_msgs/msg/PointField", **asdict(f)) for f in fields["fields"]]
        self._message(topic, "sensor_msgs/msg/PointCloud2", stamp_ns, header=self._header(stamp_ns, frame_id), **fields)

    def tf(self, stamp_ns: int, edges: Iterable[tuple[str, str, Float]], *, static: bool = False, topic: str = "") -> None:
        """Transforms (parent, child, T_parent_child) at one stamp, on /tf or /tf_static."""
        transforms = [
            self._new(
                "geometry_msgs/msg/TransformStamped",
                header=self._header(stamp_ns, parent),
                child_frame_id=child,
                transform=self._new("geometry_msgs/msg/Transform", **self._parts(T, "translation", "rotation", "Vector3")),
            )
            for parent, child, T in edges
        ]
        self._message(topic or ("/tf_static" if static else "/tf"), "tf2_msgs/msg/TFMessage", stamp_ns, transforms=transforms)

    def temperature(self, topic: str, celsius: float, stamp_ns: int, frame_id: str = "") -> None:
        """A `sensor_msgs/Temperature`."""
        self._message(
            topic,
            "sensor_msgs/msg/Temperature",
            stamp_ns,
            header=self._header(stamp_ns, frame_id),
            temperature=float(celsius),
            variance=0.0,
        )

    def pose(self, topic: str, T: Float, frame_id: str, stamp_ns: int, cov: Float | None = None) -> None:
        """A `geometry_msgs/PoseStamped`, or with a covariance (6, 6; fixed axes) a PoseWithCovarianceStamped."""
        pose = self._new("geometry_msgs/msg/Pose", **self._parts(T, "position", "orientation", "Point"))
        header = self._header(stamp_ns, frame_id)
        if cov is None:
            self._message(topic, "geometry_msgs/msg/PoseStamped", stamp_ns, header=header, pose=pose)
            return
        with_cov = self._new("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=np.asarray(cov, float).reshape(36))
        self._message(topic, "geometry_msgs/msg/PoseWithCovarianceStamped", stamp_ns, header=header, pose=with_cov)

    def raw(self, topic: str, type_name: str, cdr: bytes, stamp_ns: int) -> None:
        """A message serialised already, CDR header included; `stamp_ns` is its time in the bag."""
        writer = self._open()
        if topic not in self._connections:
            self._connections[topic] = self._guarded(
                lambda: writer.add_connection(topic, type_name, typestore=self._types, offered_qos_profiles=_qos(topic)),
            )
        self._guarded(lambda: writer.write(self._connections[topic], stamp_ns, cdr))
        self.count += 1
        self._unflushed += len(cdr)
        if self._unflushed >= FLUSH_BYTES:
            self.flush()

    def flush(self) -> None:
        """Write through to the file, so that a killed process loses nothing up to here."""
        storage: Any = self._open().storage
        self._unflushed = 0
        if self._storage == "sqlite3":
            self._guarded(storage.conn.commit)
            return
        if storage.chunk.bio.tell():
            self._guarded(storage.close_chunk)
        self._guarded(storage.bio.flush)

    def _open(self) -> Writer:
        if self._writer is None:
            raise BagError("is not open for writing", where=self.path, todo="use BagWriter in a with statement")
        return self._writer

    def _guarded(self, call: Any) -> Any:
        """Run a call that writes. If the disk is full, close the bag with the messages written so far and raise BagError."""
        import sqlite3

        try:
            return call()
        except (OSError, sqlite3.Error) as error:
            writer, self._writer = self._writer, None
            if writer is not None:
                with suppress(Exception):
                    writer.abort()
            reason = (error.strerror if isinstance(error, OSError) else None) or str(error)
            raise BagError(
                f"cannot be written further: {reason}",
                where=self.path,
                todo=f"free some space; what was on disk before ({self.count} messages written) stays readable",
            ) from None

    def _message(self, topic: str, type_name: str, stamp_ns: int, **fields: Any) -> None:
        message = self._new(type_name, **fields)
        self.raw(topic, type_name, bytes(self._types.serialize_cdr(message, type_name)), stamp_ns)

    def _new(self, type_name: str, **fields: Any) -> Any:
        return self._types.types[type_name](**fields)

    def _header(self, stamp_ns: int, frame_id: str) -> Any:
        sec, nanosec = divmod(int(stamp_ns), 1_000_000_000)
        return self._new("std_msgs/msg/Header", frame_id=frame_id, stamp=self._new("builtin_interfaces/msg/Time", sec=sec, nanosec=nanosec))

    def _parts(self, T: Float, place: str, turn: str, vector: str) -> dict[str, Any]:
        x, y, z = (float(v) for v in T[:3, 3])
        qx, qy, qz, qw = (float(v) for v in se3.quat_from_matrix(T[:3, :3]))
        return {
            place: self._new(f"geometry_msgs/msg/{vector}", x=x, y=y, z=z),
            turn: self._new("geometry_msgs/msg/Quaternion", x=qx, y=qy, z=qz, w=qw),
        }


def _qos(topic: str) -> list[Qos]:
    """QoS that the bag states as offered: latched for static transforms, so that players publish them latched."""
    from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime

    volatile = Qos(
        QosHistory.KEEP_LAST,
        10,
        QosReliability.RELIABLE,
        QosDurability.VOLATILE,
        QosTime(0, 0),
        QosTime(0, 0),
        QosLiveliness.AUTOMATIC,
        QosTime(0, 0),
        avoid_ros_namespace_conventions=False,
    )
    return [volatile._replace(durability=QosDurability.TRANSIENT_LOCAL)] if topic.endswith("tf_static") else [volatile]
