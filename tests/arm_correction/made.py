# SPDX-License-Identifier: Apache-2.0
"""Depth images of small scenes from known poses, made without the rooms under test."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from arm_correction.config import CorrectConfig, RegisterConfig, TrustConfig
from arm_correction.match import make_matcher, reference_surface
from arm_correction.reference import Reference, capture_reference
from arm_correction.register import Registration, register
from tests.tof_align.made import box, look, scene_of
from tof_core import se3
from tof_core.camera import Camera
from tof_core.capture import RobotPose, View
from tof_scene.raycast import Raycaster

if TYPE_CHECKING:
    from tof_core.arrays import Float

CAMERA = Camera(160, 120, 150.0, 150.0, 79.2, 60.9, frame_id="camera")
CONFIG = CorrectConfig(RegisterConfig(tried=4096, kept=48), TrustConfig())
FIRST = look(np.array([0.85, 0.15, 0.95]), np.array([0.0, 0.0, 0.8]))


def seen(
    caster: Raycaster, T: Float, *, believed: Float | None = None, noise_mm: float = 0.7, seed: int = 0, camera: Camera = CAMERA
) -> View:
    """The view from T as 10 captures would give it; the robot's own pose is `believed` (default: the truth)."""
    rays = camera.rays().reshape(-1, 3) @ T[:3, :3].T
    z = caster.cast(T[:3, 3], rays).t.reshape(camera.shape)
    z = z + np.random.default_rng(seed).normal(size=z.shape) * noise_mm * 1e-3
    ok = np.isfinite(z)
    return View(
        1,
        1,
        camera,
        z.astype(np.float32),
        np.where(ok, noise_mm * 1e-3, np.nan).astype(np.float32),
        np.where(ok, 10, 0).astype(np.uint16),
        (~ok).astype(np.uint8),
        RobotPose(np.eye(4), T if believed is None else believed),
        captures=10,
    )


def reference(caster: Raycaster, T: Float = FIRST) -> Reference:
    """The reference view from T."""
    return capture_reference(seen(caster, T, seed=99), CONFIG.weights)


def registered(caster: Raycaster, motion: Float, *, seed: int = 0) -> Registration:
    """From FIRST moved by `motion` (4, 4) in its own axes; the robot's own pose has not changed."""
    view = seen(caster, FIRST @ motion, believed=FIRST, seed=seed)
    ref = reference(caster)
    return register(make_matcher(reference_surface(ref, CONFIG), view, CONFIG), np.eye(4))


def twist(mm: tuple[float, float, float], deg: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Float:
    """A motion (4, 4)."""
    return se3.exp(np.concatenate([np.array(mm) * 1e-3, np.radians(deg)]))


def post() -> Raycaster:
    """A round post without background: rotation about it and translation along it are not observable."""
    angle = np.linspace(0, 2 * np.pi, 161)[:-1]
    ring = np.stack([0.15 * np.cos(angle), 0.15 * np.sin(angle)], axis=1)
    vertices = np.concatenate([np.insert(ring, 2, -3.0, axis=1), np.insert(ring, 2, 4.0, axis=1)])
    i = np.arange(160)
    j = (i + 1) % 160
    faces = np.concatenate([np.stack([i, j, i + 160], 1), np.stack([j, j + 160, i + 160], 1)]).astype(np.int32)
    part = box("post", (1, 1, 1), np.eye(4))
    return Raycaster(scene_of(type(part)("post", vertices, faces)))
