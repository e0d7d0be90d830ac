# SPDX-License-Identifier: Apache-2.0
"""Change of a pixel's depth by small motions of camera, ray and surface.

For a surface point p = z r with normal n (both in the camera frame) the ray stays and the surface moves:
n . (z' r) = n . p', so dz = n . dp / (n . r), first order in the motion.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tof_sensor.frame import once_per_frame

if TYPE_CHECKING:
    from tof_core.arrays import Float
    from tof_sensor.frame import Frame

MIN_COSINE = 0.05
"""Least cosine between ray and normal; at flatter angles columns are 0, since the first order is not valid."""


def slope(frame: Frame) -> Float:
    """(H, W, 3) n / (n . r): change of z per motion of the surface point."""
    rays = frame.rays
    n = frame.rendering.normal.astype(np.float64)
    along = np.einsum("hwi,hwi->hw", n, rays)
    limit = MIN_COSINE * frame.length
    steep = ~(np.abs(along) > limit)
    return np.where(steep[..., None], 0.0, n / np.where(steep, 1.0, along)[..., None])


def pose_columns(frame: Frame) -> Float:
    """(H, W, 6) change of z in metres per unit of a right perturbation `T_cell_camera @ exp(xi)`."""
    g = slope(frame)
    points = np.nan_to_num(frame.points)
    return np.concatenate([-g, -np.asarray(np.cross(points, g))], axis=-1)


def beside_poses(columns: Float, poses: Float) -> Float:
    """(n, m) columns less what the columns of a pose (n, 6) explain by least squares; fewer than six may be independent."""
    return np.asarray(columns - poses @ np.linalg.lstsq(poses, columns, rcond=None)[0])


def ray_columns(frame: Frame, shift: Float) -> Float:
    """(H, W, k) change of z in metres if the true ray differs by `shift` (H, W, 2, k) in normalised x, y."""
    g = slope(frame)[..., :2]
    z = np.nan_to_num(frame.depth)
    return np.asarray(-z[..., None] * np.einsum("hwi,hwik->hwk", g, shift))


def cell_points(frame: Frame) -> Float:
    """(H, W, 3) surface points in the cell frame, metres; NaN off the CAD."""
    T = frame.rendering.T_cell_camera
    return np.asarray(frame.points @ T[:3, :3].T + T[:3, 3])


@once_per_frame
def cell_surface(frame: Frame) -> tuple[Float, Float]:
    """(H, W, 3) surface points in the cell frame, metres, 0 off the CAD; (H, W, 3) change of z per motion of the point in that frame."""
    return np.nan_to_num(cell_points(frame)), np.asarray(slope(frame) @ frame.rendering.T_cell_camera[:3, :3].T)


def image_flow(frame: Frame) -> tuple[Float, Float]:
    """(H, W) optical flow in pixels per second, along columns and along rows, by the camera's twist; 0 without a surface."""
    v, w = frame.context.twist[:3], frame.context.twist[3:]
    points = np.nan_to_num(frame.points)
    velocity = -v - np.cross(w, points)
    z = np.where(points[..., 2] > 0, points[..., 2], np.inf)
    along_u = frame.camera.fx * (velocity[..., 0] - points[..., 0] / z * velocity[..., 2]) / z
    along_v = frame.camera.fy * (velocity[..., 1] - points[..., 1] / z * velocity[..., 2]) / z
    return along_u, along_v
