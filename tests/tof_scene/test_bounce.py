# SPDX-License-Identifier: Apache-2.0
"""Light by way of another part: its size on known geometry, its emitter, and what shadow does to it."""

from __future__ import annotations

import numpy as np
import pytest

from tof_scene.bounce import one_bounce
from tof_scene.builtin.shapes import box
from tof_scene.raycast import Raycaster
from tof_scene.scene import Material, Part, Scene

LAMP = np.array([1.0, 0.0, 1.0])
FLOOR, WALL = ((4.0, 4.0, 0.02), (0.0, 0.0, -0.01)), ((0.02, 4.0, 4.0), (-0.01, 0.0, 2.0))


def scene(*parts: tuple[str, tuple[tuple[float, ...], tuple[float, ...]], float]) -> Raycaster:
    return Raycaster(Scene("cell", tuple(Part(name, *box(*solid), Material(albedo)) for name, solid, albedo in parts)))


def by_quadrature(point: np.ndarray, albedo: float) -> float:
    """The shift, metres, that a lit wall at x = 0 causes at a point of the floor: the integral over the wall's area."""
    y, z = np.meshgrid(np.arange(-2, 2, 0.004) + 0.002, np.arange(0, 4, 0.004) + 0.002)
    at = np.stack([np.zeros_like(y), y, z], -1)
    to_lamp, to_point = LAMP - at, point - at
    far, near = np.linalg.norm(to_lamp, axis=-1), np.linalg.norm(to_point, axis=-1)
    radiosity = albedo * to_lamp[..., 0] / far**3
    received = radiosity * (to_point[..., 0] / near) * (-to_point[..., 2] / near) / (np.pi * near**2) * 0.004**2
    own = LAMP - point
    way = np.linalg.norm(own)
    return float((received * 0.5 * (far + near - way)).sum() / (own[2] / way**3))


def test_a_corner_has_the_light_of_its_wall() -> None:
    caster = scene(("floor", FLOOR, 0.5), ("wall", WALL, 0.4))
    points = np.array([[0.1, 0.0, 0.0], [0.3, 0.1, 0.0], [0.8, 0.0, 0.0]])
    light = one_bounce(caster, LAMP, points, np.tile([0.0, 0.0, 1.0], (3, 1)), rays=4096)
    assert light[:, 0] == pytest.approx(0.0, abs=1e-12), "a plane does not light itself"
    assert light[:, 1] == pytest.approx([by_quadrature(p, 0.4) for p in points], rel=0.03)
    brighter = scene(("floor", FLOOR, 0.5), ("wall", WALL, 0.8))
    assert one_bounce(brighter, LAMP, points, np.tile([0.0, 0.0, 1.0], (3, 1)), rays=4096)[:, 1] == pytest.approx(2 * light[:, 1])


def test_a_wall_in_shadow_sends_nothing() -> None:
    screen = ((0.02, 1.9, 1.5), (0.5, 0.0, 1.25))
    caster = scene(("floor", FLOOR, 0.5), ("wall", WALL, 0.4), ("screen", screen, 0.4))
    point, up = np.array([[0.2, 0.0, 0.0]]), np.array([[0.0, 0.0, 1.0]])
    free = one_bounce(scene(("floor", FLOOR, 0.5), ("wall", WALL, 0.4)), LAMP, point, up, rays=1024)[0, 1]
    assert one_bounce(caster, LAMP, point, up, rays=1024)[0, 1] < 0.5 * free
