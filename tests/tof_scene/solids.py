# SPDX-License-Identifier: Apache-2.0
"""Scenes whose depth is known in closed form, and cameras to look at them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tof_core.camera import Camera
from tof_scene.builtin.shapes import box, moved, sphere, tube
from tof_scene.scene import Material, Part, Scene

if TYPE_CHECKING:
    from tof_core.arrays import Float
    from tof_scene.builtin.shapes import Solid


def camera(width: int = 80, height: int = 60, fov_deg: float = 56.0, **lens: object) -> Camera:
    f = width / 2 / np.tan(np.radians(fov_deg / 2))
    return Camera(width, height, f, f, width / 2 - 0.5, height / 2 - 0.5, **lens)  # type: ignore[arg-type]


def looking(eye: tuple[float, float, float], at: tuple[float, float, float]) -> Float:
    """T_cell_camera at `eye`, optical axis toward `at`, image upright in a cell whose z is up."""
    z = np.subtract(at, eye) / np.linalg.norm(np.subtract(at, eye))
    x = np.cross(z, [0.0, 0.0, 1.0])
    x /= np.linalg.norm(x)
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = np.stack([x, np.cross(z, x), z], axis=1), eye
    return T


def scene(**solids: Solid) -> Scene:
    """A scene of one part per solid, albedos 0.1, 0.2, ..."""
    return Scene("cell", tuple(Part(name, *solid, Material(0.1 * (i + 1))) for i, (name, solid) in enumerate(solids.items())))


def wall(x: float = 0.0) -> Solid:
    """A wall facing +x whose surface is the plane at `x`."""
    return box((0.1, 8.0, 8.0), (x - 0.05, 0.0, 0.0))


def ball(radius: float, segments: int = 800) -> Solid:
    return sphere(radius, segments)


def bar(radius: float, segments: int = 2000) -> Solid:
    """A cylinder along y around the origin."""
    return tube(np.linspace((0.0, -2.0, 0.0), (0.0, 2.0, 0.0), 3), radius, segments)


def block(x: float, y: float, z: float, size: tuple[float, float, float]) -> Solid:
    return moved(box(size), (x, y, z))


def rays_in_cell(cam: Camera, T: Float) -> Float:
    """(H, W, 3) directions with z = 1 in the camera, in the cell frame."""
    return cam.rays() @ T[:3, :3].T


def nearest_root(a: Float, b: Float, c: Float) -> Float:
    """Smaller root of a t² + 2 b t + c = 0, NaN where there is none."""
    with np.errstate(invalid="ignore"):
        return np.asarray((-b - np.sqrt(b * b - a * c)) / a)


def sphere_depth(cam: Camera, T: Float, radius: float) -> Float:
    d, o = rays_in_cell(cam, T), T[:3, 3]
    return nearest_root(np.sum(d * d, -1), d @ o, np.asarray(o @ o - radius**2))


def bar_depth(cam: Camera, T: Float, radius: float) -> Float:
    d, o = rays_in_cell(cam, T)[..., [0, 2]], T[[0, 2], 3]
    return nearest_root(np.sum(d * d, -1), d @ o, np.asarray(o @ o - radius**2))
