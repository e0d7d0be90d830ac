# SPDX-License-Identifier: Apache-2.0
"""Shapes for the virtual camera to look at."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tof_core.config import from_mapping
from tof_virtual.body import Body
from tof_virtual.calibrate import calibrate
from tof_virtual.config import VirtualConfig
from tof_virtual.session import Session

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from tof_core.arrays import Float


def quad(name: str, corners: ArrayLike, *, albedo: float = 0.5, roughness: float = 1.0) -> Body:
    """A rectangle from its four corners in order."""
    return Body(name, np.asarray(corners, float), np.array([[0, 1, 2], [0, 2, 3]], np.int32), albedo, roughness)


def wall(
    name: str = "wall", *, x: float = 0.0, half: float = 0.6, albedo: float = 0.5, roughness: float = 1.0, centre: float = 0.8
) -> Body:
    """A square wall in the plane x, facing +x, around height `centre`."""
    lo, hi = centre - half, centre + half
    return quad(name, [[x, -half, lo], [x, half, lo], [x, half, hi], [x, -half, hi]], albedo=albedo, roughness=roughness)


def box(name: str, low: ArrayLike, high: ArrayLike, albedo: float = 0.5) -> Body:
    """An axis-aligned box, triangles outwards."""
    lo, hi = np.asarray(low, float), np.asarray(high, float)
    vertices = np.array([[(lo, hi)[i][0], (lo, hi)[j][1], (lo, hi)[k][2]] for i in (0, 1) for j in (0, 1) for k in (0, 1)])
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = np.array([f for a, b, c, d in quads for f in ((a, b, c), (a, c, d))], np.int32)
    return Body(name, vertices, faces, albedo)


def bench() -> list[Body]:
    """A wall with two boxes of other reflectance before it, a floor: convex and concave, bright and dark."""
    return [
        wall(half=0.7, albedo=0.5),
        box("bright", [0.0, -0.35, 0.6], [0.12, -0.05, 0.95], 0.8),
        box("dark", [0.0, 0.08, 0.7], [0.2, 0.3, 1.0], 0.09),
        quad("shelf", [[0, -0.7, 0.45], [0.45, -0.7, 0.45], [0.45, 0.7, 0.45], [0, 0.7, 0.45]], albedo=0.6),
    ]


def looking(x: float, y: float = 0.0, z: float = 0.8) -> Float:
    """`T_cell_camera` of a camera at (x, y, z) that looks along -x, image upright."""
    T = np.eye(4)
    T[:3, :3] = np.array([[0.0, 0, -1], [1, 0, 0], [0, -1, 0]])
    T[:3, 3] = x, y, z
    return T


def config(**extra: object) -> VirtualConfig:
    """A small session; double underscores in names stand for dots."""
    small = {"camera.width": 80, "camera.height": 60, "plan.views": 4, "output.encoding": "32FC1"}
    return from_mapping(VirtualConfig, small | {k.replace("__", "."): v for k, v in extra.items()})


def session(effects: dict[str, float], bodies: list[Body] | None = None, **extra: object) -> Session:
    """A planned session with its effects at the size of their strength."""
    made = Session(bodies or bench(), config(**extra), effects)
    calibrate(made)
    return made


def biases(made: Session, name: str) -> Float:
    """(V, P) bias of an effect, per capture."""
    effect = next(e for e in made.effects if e.name == name)
    return np.stack([made.bias(i, effect) for i in range(len(made.shutters))])
