# SPDX-License-Identifier: Apache-2.0
"""The colour camera beside the depth camera: flat paint, two lamps that change from station to station, hard shadows."""

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

AMBIENT = 0.35
"""Share of light that comes from everywhere."""
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


def photograph(session: Session, index: int) -> Bytes:
    """RGB image (480, 640, 3) at the moment of a capture."""
    shutter = session.shutters[index]
    world, camera = session.world(session.effects), colour_camera(session.config)
    T = session.true_pose(shutter) @ se3.inverse(HAND_OF_CAMERA) @ HAND_OF_COLOUR
    rays = camera.rays().reshape(-1, 3) @ T[:3, :3].T
    z, face = world.tree.cast(np.ascontiguousarray(T[:3, 3]), rays)
    hit = np.flatnonzero(face >= 0)
    normal = world.soup.normals[face[hit]]
    normal = normal * -np.sign(np.einsum("ij,ij->i", normal, rays[hit]))[:, None]
    points = T[:3, 3] + rays[hit] * z[hit, None] + 1e-5 * normal
    light = np.full((hit.size, 3), AMBIENT)
    for lamp, rgb in _lamps(session, session.stops[shutter.stop].station):
        way = lamp - points
        shading = np.clip(np.einsum("ij,ij->i", way, normal) / np.linalg.norm(way, axis=1), 0, None)
        lit = np.flatnonzero(shading > 0)
        shading[lit] *= ~world.tree.blocked(points[lit], np.broadcast_to(lamp, (lit.size, 3)))
        light += shading[:, None] * rgb
    paints = np.stack([paint(b.albedo) for b in session.bodies])
    linear = np.full((face.size, 3), BACKGROUND)
    linear[hit] = paints[world.soup.body[face[hit]]] * light
    noise = np.random.default_rng([session.config.seed, 99, index]).standard_normal(linear.shape, dtype=np.float32)
    grey = 255 * np.clip(linear, 0, 1) ** (1 / 2.2) + NOISE * noise
    return np.asarray(np.clip(grey + 0.5, 0, 255), np.uint8).reshape(*camera.shape, 3)


def _lamps(session: Session, station: int) -> list[tuple[Float, Float]]:
    """Position (3,) and linear RGB (3,) of each lamp; the light changes between stations."""
    rng = np.random.default_rng([session.config.seed, 98, station])
    target = session.nominal.soup.centre
    sides = np.radians(session.config.plan.facing_deg + np.array([-60, 60]) + rng.uniform(-30, 30, 2))
    lamps = []
    for side, strength in zip(sides, rng.uniform(0.5, 1.1, 2), strict=True):
        away = np.array([2.5 * np.cos(side), 2.5 * np.sin(side), rng.uniform(1.5, 2.5)])
        lamps.append((target + away, strength * (1 + 0.08 * rng.uniform(-1, 1, 3))))
    return lamps
