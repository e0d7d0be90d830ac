# SPDX-License-Identifier: Apache-2.0
"""Depth images through librealsense's filters (threshold, spatial, temporal), by its software device: a peer of our filters."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.capture import Capture

UNIT_M = 0.001
"""Metres per code of its depth images."""


def frames_of(captures: Sequence[Capture]) -> list[Any]:
    """The captures as frames of a software device; millimetres, 0 where invalid."""
    import pyrealsense2 as rs

    height, width = captures[0].camera.shape
    stream, intrinsics = rs.video_stream(), rs.intrinsics()
    stream.type, stream.index, stream.uid, stream.fps, stream.bpp, stream.fmt = rs.stream.depth, 0, 0, 30, 2, rs.format.z16
    stream.width, stream.height = intrinsics.width, intrinsics.height = width, height
    intrinsics.fx = intrinsics.fy = 1.0 / captures[0].camera.pixel_angle
    intrinsics.ppx, intrinsics.ppy, intrinsics.model = width / 2, height / 2, rs.distortion.none
    stream.intrinsics = intrinsics
    device = rs.software_device()  # its sensor does not keep it
    sensor = device.add_sensor("Depth")
    profile = sensor.add_video_stream(stream)
    sensor.add_read_only_option(rs.option.depth_units, UNIT_M)
    queue = rs.frame_queue(len(captures), keep_frames=True)
    sensor.open(profile)
    sensor.start(queue)
    frames, images = [], [np.round(np.nan_to_num(c.depth) / UNIT_M).astype(np.uint16) for c in captures]
    for k, image in enumerate(images):
        frame = rs.software_video_frame()
        frame.pixels, frame.stride, frame.bpp, frame.depth_units = image, 2 * width, 2, UNIT_M
        frame.timestamp, frame.frame_number, frame.domain = 1e3 * k / 30, k + 1, rs.timestamp_domain.system_time
        frame.profile = profile.as_video_stream_profile()
        sensor.on_video_frame(frame)
        frames.append(queue.wait_for_frame(2000))
    return frames


def filter_seconds(frames: Sequence[Any]) -> list[float]:
    """Processor seconds of the chain for each frame, one after the other."""
    import pyrealsense2 as rs

    threshold, spatial, temporal = rs.threshold_filter(0.1, 4.0), rs.spatial_filter(), rs.temporal_filter()
    seconds = []
    for frame in frames:
        started = time.thread_time()
        temporal.process(spatial.process(threshold.process(frame)))
        seconds.append(time.thread_time() - started)
    return seconds
