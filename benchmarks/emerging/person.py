# SPDX-License-Identifier: Apache-2.0
"""A person's arm that reaches into some views: from beside the picture to a point just above what the camera looks at."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tof_virtual.body import Body

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from tof_core.arrays import Float
    from tof_virtual.sight import World

ARM = "arm"
"""Name of the arm among the bodies."""
ALBEDO = 0.45
"""Of skin and cloth in the near infrared."""
ELBOW_M, WRIST_M, FIST_M, LENGTH_M = 0.05, 0.03, 0.045, 0.45
"""Radii of the elbow, the wrist and the fist; length from fist to elbow."""
ABOVE_M = 0.06
"""From the surface to the middle of the fist: it works just above the part."""
SIDES = 16


def reaches(stop: int, share: float, serial: int) -> bool:
    """Whether the arm is in the views of a stop: in `share` of them, in an order that the serial number decides."""
    first = np.random.default_rng([serial, 61]).random()
    return int(np.floor(first + (stop + 1) * share)) > int(np.floor(first + stop * share))


def arm(world: World, T_cell_camera: Float, half_fov: float, stop: int, serial: int) -> Body | None:
    """The arm as it stands in one view; None where the view looks at nothing.

    Args:
        world: what stands in the cell without it.
        T_cell_camera: (4, 4) where the camera is.
        half_fov: tangent of half the field of view.
        stop: number of the view, which decides where the arm is.
        serial: of the camera.
    """
    rng = np.random.default_rng([serial, 67, stop])
    angle, aside = rng.uniform(0, 2 * np.pi), 0.5 * half_fov * rng.uniform(-1, 1, 2)
    R, eye = T_cell_camera[:3, :3], T_cell_camera[:3, 3]
    ray = R @ np.array([*aside, 1.0])
    z, _ = world.tree.cast(np.ascontiguousarray(eye), ray[None])
    if not np.isfinite(z[0]):
        return None
    fist = eye + ray * (z[0] - ABOVE_M)
    # Towards the picture's border, and towards the camera by a third of that.
    way = R @ np.array([np.cos(angle), np.sin(angle), -0.35])
    return Body(ARM, *_tapered(fist, way / np.linalg.norm(way)), ALBEDO)


def _tapered(fist: Float, way: Float) -> tuple[Float, NDArray[np.int32]]:
    """Vertices and triangles of rings along the arm."""
    along = np.array([-FIST_M, -0.7 * FIST_M, 0.0, 0.06, 0.1, LENGTH_M])
    radii = np.array([0.3 * FIST_M, 0.8 * FIST_M, FIST_M, 0.9 * FIST_M, WRIST_M, ELBOW_M])
    u = np.cross(way, [0.0, 0.0, 1.0] if abs(way[2]) < 0.9 else [1.0, 0.0, 0.0])
    u /= np.linalg.norm(u)
    v = np.cross(way, u)
    turn = 2 * np.pi * np.arange(SIDES) / SIDES
    ring = np.cos(turn)[:, None] * u + np.sin(turn)[:, None] * v
    rings = fist + along[:, None, None] * way + radii[:, None, None] * ring
    ends = fist + np.outer(along[[0, -1]], way)
    k, i = np.meshgrid(np.arange(len(along) - 1), np.arange(SIDES), indexing="ij")
    a, b = (k * SIDES + i).ravel(), (k * SIDES + (i + 1) % SIDES).ravel()
    walls = np.concatenate([np.stack([a, b, b + SIDES], 1), np.stack([a, b + SIDES, a + SIDES], 1)])
    j, first, last = np.arange(SIDES), len(along) * SIDES, (len(along) - 1) * SIDES
    caps = [
        np.stack([np.full(SIDES, first), (j + 1) % SIDES, j], 1),
        np.stack([np.full(SIDES, first + 1), last + j, last + (j + 1) % SIDES], 1),
    ]
    return np.concatenate([rings.reshape(-1, 3), ends]), np.concatenate([walls, *caps]).astype(np.int32)
