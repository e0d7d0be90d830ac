# SPDX-License-Identifier: Apache-2.0
"""A plate with small parts on it, seen with noise, with some parts gone or moved."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from tests.tof_align.made import at, box, look, scene_of
from tof_core.camera import Camera
from tof_core.capture import Posed, RobotPose, View
from tof_scene.raycast import Raycaster

if TYPE_CHECKING:
    from collections.abc import Mapping

    from tof_core.arrays import Float
    from tof_scene.scene import Scene

CAMERA = Camera(160, 120, 190.0, 190.0, 79.2, 60.9, frame_id="camera")
EYE = look(np.array([0.55, 0.12, 0.9]), np.array([0.0, 0.0, 0.8]))
SURE = Posed(EYE, np.diag(np.repeat([1e-4, 2e-4], 3)) ** 2)


def plate() -> Scene:
    """A wall with a clip (30 x 30 x 8 mm), a block, a shim of 1 mm, a speck, a block behind the wall and one buried in another."""
    parts = {
        "clip": ((0.008, 0.03, 0.03), (0.019, -0.06, 0.82)),
        "block": ((0.03, 0.04, 0.03), (0.03, 0.05, 0.78)),
        "shim": ((0.001, 0.03, 0.03), (0.0155, 0.02, 0.85)),
        "speck": ((0.008, 0.004, 0.004), (0.019, -0.05, 0.76)),
        "behind": ((0.02, 0.03, 0.03), (-0.05, 0.0, 0.8)),
        "buried": ((0.01, 0.01, 0.01), (0.03, 0.05, 0.78)),
    }
    wall = box("wall", (0.03, 0.5, 0.5), np.eye(4) @ at(0.0, 0.0, 0.8))
    return scene_of(wall, *(replace(box(name, size, at(*where)), inspect=True) for name, (size, where) in parts.items()))


def as_built(scene: Scene, gone: tuple[str, ...] = (), moved: Mapping[str, tuple[float, float, float]] | None = None) -> Scene:
    """The scene as built: without some parts, others moved by millimetres."""
    shift = {name: np.array(mm) * 1e-3 for name, mm in (moved or {}).items()}
    parts = [replace(p, vertices=p.vertices + shift.get(p.name, 0.0)) for p in scene.parts if p.name not in gone]
    return replace(scene, parts=tuple(parts), digest="")


def seen(built: Scene, *, noise_mm: float = 1.0, seed: int = 0, T: Float = EYE) -> View:
    """The camera's measurement of a scene."""
    rays = CAMERA.rays().reshape(-1, 3) @ T[:3, :3].T
    z = Raycaster(built).cast(T[:3, 3], rays).t.reshape(CAMERA.shape)
    z = z + np.random.default_rng(seed).normal(size=z.shape) * noise_mm * 1e-3
    ok = np.isfinite(z)
    return View(
        1,
        1,
        CAMERA,
        z.astype(np.float32),
        np.where(ok, noise_mm * 1e-3, np.nan).astype(np.float32),
        np.where(ok, 10, 0).astype(np.uint16),
        (~ok).astype(np.uint8),
        RobotPose(np.eye(4), T),
        captures=10,
    )
