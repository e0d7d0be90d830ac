# SPDX-License-Identifier: Apache-2.0
"""PointCloud2 to depth images: an organised cloud keeps its raster, others are projected with CameraInfo's intrinsics."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from tof_core.errors import DecodeError
from tof_core.reasons import Reason

if TYPE_CHECKING:
    from tof_core.arrays import Bytes, Float, Image
    from tof_core.camera import Camera

DATATYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
"""PointField.datatype codes."""


def cloud_fields(msg: Any, names: tuple[str, ...], where: str = "") -> list[Float]:
    """Fields of a `sensor_msgs/PointCloud2`, each (height, width) float64; row padding and byte order honoured."""
    known = {f.name: f for f in msg.fields}
    missing = [name for name in names if name not in known]
    if missing:
        what = f"cloud has no field '{missing[0]}'"
        raise DecodeError(what, where=where, todo=f"its fields are {', '.join(known) or 'none'}")
    order = ">" if msg.is_bigendian else "<"
    height, width, step = int(msg.height), int(msg.width), int(msg.point_step)
    offsets, formats = [int(known[n].offset) for n in names], [order + _element(known[n].datatype, where) for n in names]
    if step >= 2**31 or any(not 0 <= at <= step - np.dtype(f).itemsize for at, f in zip(offsets, formats, strict=True)):
        what = f"cloud has fields at bytes {', '.join(map(str, offsets))} of points of {step} bytes"
        raise DecodeError(what, where=where, todo="the publisher's point_step and offsets must agree")
    layout = np.dtype({"names": list(names), "itemsize": step, "offsets": offsets, "formats": formats})
    data = np.frombuffer(msg.data, np.uint8)
    row_step = int(msg.row_step) or width * step
    if row_step < width * step or data.size < (height - 1) * row_step + width * step or not width * height:
        what = f"cloud of {width}x{height} points of {step} bytes does not fit its {data.size} bytes"
        raise DecodeError(what, where=where, todo="the publisher must send whole rows")
    rows = np.lib.stride_tricks.as_strided(data, (height, width * step), (row_step, 1))
    points = np.ascontiguousarray(rows).view(layout).reshape(height, width)
    return [points[name].astype(np.float64) for name in names]


def _element(datatype: int, where: str) -> str:
    try:
        return DATATYPES[int(datatype)]
    except KeyError:
        what = f"PointField datatype {datatype} is not known"
        raise DecodeError(what, where=where) from None


def depth_from_points(
    msg: Any,
    camera: Camera,
    T_camera_cloud: Float | None = None,
    where: str = "",
) -> tuple[Image, Bytes]:
    """z-depth (H, W) in metres and reason map of a `sensor_msgs/PointCloud2`.

    A cloud organised on the camera's own raster keeps that raster; any other cloud is projected, and of the points
    in a pixel the nearest is kept (z-buffer). `T_camera_cloud` is needed where the cloud is in another frame.
    """
    xyz = np.stack(cloud_fields(msg, ("x", "y", "z"), where), axis=-1)
    if T_camera_cloud is not None:
        xyz = xyz @ T_camera_cloud[:3, :3].T + T_camera_cloud[:3, 3]
    depth = _organised(xyz) if _on_raster(xyz, camera) else _projected(xyz.reshape(-1, 3), camera)
    reason = np.where(np.isnan(depth), np.uint8(Reason.NO_RETURN), np.uint8(Reason.VALID))
    return depth, reason


def _on_raster(xyz: Float, camera: Camera, tolerance_px: float = 0.5) -> bool:
    """Whether each point of an organised cloud projects to its own pixel (2000 to 4000 points are tested)."""
    if xyz.shape[:2] != camera.shape:
        return False
    v, u = np.nonzero(np.isfinite(xyz).all(axis=-1) & (xyz[..., 2] > 0))
    if not len(v):
        return True
    some = slice(None, None, max(len(v) // 2000, 1))
    error = camera.project(xyz[v[some], u[some]]) - np.stack([u[some], v[some]], axis=-1)
    error = error[np.isfinite(error)]
    return bool(error.size) and bool(np.median(np.abs(error)) < tolerance_px)


def _organised(xyz: Float) -> Image:
    z = xyz[..., 2]
    seen = np.isfinite(xyz).all(axis=-1) & (z > 0)
    return np.where(seen, z, np.nan).astype(np.float32)


def _projected(points: Float, camera: Camera) -> Image:
    points = points[np.isfinite(points).all(axis=-1) & (points[:, 2] > 0)]
    uv = camera.project(points)
    points, uv = points[np.isfinite(uv).all(axis=-1)], uv[np.isfinite(uv).all(axis=-1)]
    u, v = np.rint(uv).astype(np.int64).T if len(uv) else (np.empty(0, np.int64),) * 2
    inside = (u >= 0) & (u < camera.width) & (v >= 0) & (v < camera.height)
    depth = np.full(camera.height * camera.width, np.inf, np.float32)
    np.minimum.at(depth, v[inside] * camera.width + u[inside], points[inside, 2].astype(np.float32))
    depth[np.isinf(depth)] = np.nan
    return depth.reshape(camera.shape)
