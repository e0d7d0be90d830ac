# SPDX-License-Identifier: Apache-2.0
"""Checks of CameraInfo: calibrated, size and frame of the image, constant, plausible field of view."""

from __future__ import annotations

from math import atan, degrees
from typing import TYPE_CHECKING, Any

import numpy as np

from tof_core.decode import camera_from_info, image_size
from tof_core.errors import CameraError
from tof_core.topics import is_rectified
from toftwin.doctor.finding import fix, note, ok, refused

if TYPE_CHECKING:
    from collections.abc import Iterator

    from tof_core.camera import Camera
    from tof_core.topics import Topics
    from toftwin.doctor.finding import Finding
    from toftwin.doctor.recording import Stream

CHECK = "CameraInfo"
FIELD_DEG = (15.0, 120.0)
"""Smallest and largest field of view of depth cameras."""
CALIBRATE = "calibrate the camera, or let the driver publish the K of this image size"


def camera_of(topics: Topics, streams: dict[str, Stream]) -> tuple[Camera | None, list[Finding]]:
    """The depth camera, None if its CameraInfo cannot be used; and the findings about it."""
    infos = streams[topics.info].kept
    rectified = is_rectified(topics.depth)
    try:
        cameras = [camera_from_info(m, topics.info, rectified=rectified) for m in infos]
    except CameraError as error:
        return None, [refused(CHECK, error)]
    return cameras[0], list(_findings(topics, cameras, streams[topics.depth or topics.points].kept))


def _findings(topics: Topics, cameras: list[Camera], images: list[Any]) -> Iterator[Finding]:
    camera = cameras[0]
    yield ok(CHECK, f"{described(camera)}, frame '{camera.frame_id}'")
    if any(c != camera for c in cameras):
        yield fix(CHECK, f"{topics.info} changes within the recording", "keep one camera mode in a session; label each mode separately")
    yield from plausible(camera)
    if topics.depth:
        yield from _of_image(camera, images, topics)


def described(camera: Camera) -> str:
    """Size, focal length and field of view in words."""
    width, height = field_deg(camera)
    return f"{camera.width}x{camera.height}, fx {camera.fx:.1f}, {width:.1f} x {height:.1f} degrees"


def field_deg(camera: Camera) -> tuple[float, float]:
    """Horizontal and vertical field of view through the middle of the image, degrees; without distortion where it reaches beyond the lens."""
    at_ends = [[-0.5, camera.cy], [camera.width - 0.5, camera.cy]], [[camera.cx, -0.5], [camera.cx, camera.height - 0.5]]
    width, height = (float(np.degrees(np.ptp(np.arctan(camera.rays_at(ends)[:, axis])))) for axis, ends in enumerate(at_ends))
    return (width, height) if np.isfinite([width, height]).all() else _of_matrix_deg(camera)


def _of_matrix_deg(camera: Camera) -> tuple[float, float]:
    """Field of view by the camera matrix alone, degrees."""
    return 2 * degrees(atan(camera.width / 2 / camera.fx)), 2 * degrees(atan(camera.height / 2 / camera.fy))


def plausible(camera: Camera) -> Iterator[Finding]:
    """Findings about values that no calibration of this image size gives."""
    angles = _of_matrix_deg(camera)
    if not all(FIELD_DEG[0] < a < FIELD_DEG[1] for a in angles):
        what = f"field of view {angles[0]:.0f} x {angles[1]:.0f} degrees: K seems to belong to an image size other than {camera.width}x{camera.height}"
        yield fix(CHECK, what, CALIBRATE)
    if not (0.25 < camera.cx / camera.width < 0.75 and 0.25 < camera.cy / camera.height < 0.75):
        yield fix(CHECK, f"principal point ({camera.cx:.0f}, {camera.cy:.0f}) is far from the image centre", CALIBRATE)
    if abs(camera.fx / camera.fy - 1) > 0.05:
        yield note(
            CHECK,
            f"pixels are not square: fx / fy = {camera.fx / camera.fy:.3f}",
            "check that K was scaled with the image in both directions",
        )
    if not camera.distorted:
        yield note(CHECK, "no distortion: the image is treated as rectified", "if it is not, publish D; spot_ros2 always sends zeros")


def _of_image(camera: Camera, images: list[Any], topics: Topics) -> Iterator[Finding]:
    sizes = {image_size(m, topics.depth)[::-1] for m in images}
    if wrong := sizes - {(camera.width, camera.height)}:
        width, height = min(wrong)
        what = f"{topics.depth} is {width}x{height}, its CameraInfo {camera.width}x{camera.height}"
        yield fix(CHECK, what, "publish the camera_info of this image size, or name it with --info-topic")
    frames = {str(m.header.frame_id).lstrip("/") for m in images}
    if frames != {camera.frame_id.lstrip("/")}:
        yield note(
            CHECK,
            f"image is in frame {', '.join(sorted(frames))!r}, CameraInfo in '{camera.frame_id}'",
            "the frame of the image is used; let the driver publish the same frame in both",
        )
