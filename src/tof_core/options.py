# SPDX-License-Identifier: Apache-2.0
"""Options of a bag or of a robot's topics: names, frames, and the meaning of depth."""

from __future__ import annotations

from dataclasses import dataclass

from tof_core.config import param

NOT_WANTED = "none"
"""A topic option that turns an optional topic off."""


@dataclass(frozen=True, slots=True)
class BagOptions:
    """Topics, frames and units of a recording; an empty name is found by type and sibling."""

    depth_topic: str = param("", "depth image (sensor_msgs/Image, or a compressed one of image_transport)")
    info_topic: str = param("", "the depth camera's calibration (sensor_msgs/CameraInfo)")
    points_topic: str = param("", "point cloud to use instead of a depth image (sensor_msgs/PointCloud2)")
    amplitude_topic: str = param("", "amplitude or infrared image; 'none' leaves it out")
    colour_topic: str = param("", "colour image; 'none' leaves it out")
    colour_info_topic: str = param("", "the colour camera's calibration")
    temperature_topic: str = param("", "camera temperature (sensor_msgs/Temperature); 'none' leaves it out")
    depth: str = param("z", "meaning of a depth value: z along the optical axis, or radial along the pixel's ray", choices=("z", "radial"))
    depth_scale: float = param(0.001, "metres of one count of an integer depth image", unit="m", low=1e-6, high=1.0)
    cell_frame: str = param("", "TF frame of the cell; empty: the scene's frame")
    body_frame: str = param("", "TF frame of the robot's base; empty: 'body' or 'base_link' on the way from cell to camera")
    max_gap_s: float = param(0.2, "longest gap in TF that is interpolated", unit="s", low=0.001, high=10.0)
    join_s: float = param(0.016, "amplitude joins a depth image when their stamps differ by at most this", unit="s", low=0.0, high=1.0)
    colour_join_s: float = param(0.5, "colour joins a depth image when their stamps differ by at most this", unit="s", low=0.0, high=60.0)
    recover: bool = param(False, "read the intact messages of a damaged bag")
    session: int = param(0, "which session of a bag whose clock was set back, from 1; 0: the longest", low=0, high=10_000)
