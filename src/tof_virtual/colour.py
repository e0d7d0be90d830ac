# SPDX-License-Identifier: Apache-2.0
"""The colour camera beside the depth camera: matt paint, two lamps that differ between stations, hard shadows."""

from __future__ import annotations

from typing import TYPE_CHECKING
from zlib import crc32

import numpy as np

from tof_core import se3
from tof_core.camera import Camera
from tof_virtual.robot import HAND_OF_CAMERA, HAND_OF_COLOUR
from tof_virtual.session import frame

if TYPE_CHECKING:
    from tof_core.arrays import Bytes, Float
    from tof_virtual.config import VirtualConfig
    from tof_virtual.session import Session
    from tof_virtual.sight import World

AMBIENT = 0.35
"""Share of the lighting that comes from all directions."""
NOISE = 1.5
"""Standard deviation of a grey value, of 255."""
BACKGROUND = 0.08


def colour_camera(config: VirtualConfig) -> Camera:
    """640x480, 65 degrees across."""
    f = 320 / np.tan(np.radians(65) / 2)
    return Camera(640, 480, float(f), float(f), 319.1, 240.4, "plumb_bob", (0.0,) * 5, frame(config, "hand_color_image_sensor"))


def paint(albedo: float) -> Float:
    """Linear RGB (3,) of a part: grey by its albedo with a slight tint of its own.

    The tint depends on the albedo alone, so that parts of one material have one colour.
    """
    rng = np.random.default_rng(crc32(f"{albedo:.3f}".encode()))
    tint = 1 + 0.25 * rng.uniform(-1, 1, 3)
    return np.asarray(np.clip(albedo * tint / tint.mean(), 0, 1))


def photograph(session: Session, T_cell_depth: Float, station: int, index: int) -> Bytes:
    """RGB image (480, 640, 3) for the true depth camera pose `T_cell_depth`, in the lighting of a station."""
    world, camera = session.world(session.effects), colour_camera(session.config)
    T = T_cell_depth @ se3.inverse(HAND_OF_CAMERA) @ HAND_OF_COLOUR
    rays = camera.rays().reshape(-1, 3) @ T[:3, :3].T
    z, face = world.tree.cast(np.ascontiguousarray(T[:3, 3]), rays)
    hit = np.flatnonzero(face >= 0)
    linear = np.full((face.size, 3), BACKGROUND)
    points = T[:3, 3] + rays[hit] * z[hit, None]
    paints = np.stack([paint(b.albedo) for b in session.bodies])
    light = _light(world, points, _facing(world.soup.normals[face[hit]], rays[hit]), _lamps(session, station))
    linear[hit] = paints[world.soup.body[face[hit]]] * light
    noise = np.random.default_rng([session.config.seed, 99, index, session.config.day]).standard_normal(linear.shape, dtype=np.float32)
    grey = 255 * np.clip(linear, 0, 1) ** (1 / 2.2) + NOISE * noise
    return np.asarray(np.clip(grey + 0.5, 0, 255), np.uint8).reshape(*camera.shape, 3)


def _facing(normals: Float, rays: Float) -> Float:
    return np.asarray(normals * -np.sign(np.einsum("ij,ij->i", normals, rays))[:, None])


def _light(world: World, points: Float, normals: Float, lamps: list[tuple[Float, Float]]) -> Float:
    """Linear RGB light (n, 3) on points: from everywhere, and from each lamp that is not hidden."""
    light = np.full((len(points), 3), AMBIENT)
    above = points + 1e-5 * normals
    for lamp, rgb in lamps:
        way = lamp - above
        shading = np.clip(np.einsum("ij,ij->i", way, normals) / np.linalg.norm(way, axis=1), 0, None)
        lit = np.flatnonzero(shading > 0)
        shading[lit] *= ~world.tree.blocked(above[lit], np.broadcast_to(lamp, (lit.size, 3)))
        light += shading[:, None] * rgb
    return light


def _lamps(session: Session, station: int) -> list[tuple[Float, Float]]:
    """Position (3,) and linear RGB (3,) of each lamp; the light changes between stations."""
    rng = np.random.default_rng([session.config.seed, 98, station, session.config.day])
    target = session.nominal.soup.centre
    sides = np.radians(session.config.plan.facing_deg + np.array([-60, 60]) + rng.uniform(-30, 30, 2))
    lamps = []
    for side, strength in zip(sides, rng.uniform(0.35, 0.8, 2), strict=True):
        away = np.array([2.5 * np.cos(side), 2.5 * np.sin(side), rng.uniform(1.5, 2.5)])
        lamps.append((target + away, strength * (1 + 0.08 * rng.uniform(-1, 1, 3))))
    return lamps
