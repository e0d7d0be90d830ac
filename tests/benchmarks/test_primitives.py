# SPDX-License-Identifier: Apache-2.0
"""Planes and spheres are fitted correctly to depth with a camera's noise."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from benchmarks.primitive_scene import mesh
from benchmarks.primitives import Plane, PrimitiveConfig, Sphere, fit_primitives
from tof_core.camera import Camera
from tof_core.errors import RefusedError

if TYPE_CHECKING:
    from tof_core.arrays import Float, Image

CAMERA = Camera(width=320, height=240, fx=260.0, fy=260.0, cx=159.5, cy=119.5)
WALL = Plane(np.array([0.0, 0.2, -0.9798]) / np.linalg.norm([0.0, 0.2, -0.9798]), -1.5)
FLOOR = Plane(np.array([0.0, -0.9798, -0.2]) / np.linalg.norm([0.0, -0.9798, -0.2]), -0.45)
BALL = Sphere(np.array([0.1, -0.05, 1.1]), 0.12)


def along(surface: Plane | Sphere, rays: Float) -> Float:
    """z at which rays (H, W, 3) meet a surface, by the textbook formula; inf where they miss."""
    if isinstance(surface, Plane):
        z = surface.offset / (rays @ surface.normal)
        return np.where(z > 0, z, np.inf)
    a, b, c = (rays**2).sum(-1), rays @ surface.centre, surface.centre @ surface.centre - surface.radius**2
    root = b * b - a * c
    return np.where(root > 0, (b - np.sqrt(np.maximum(root, 0))) / a, np.inf)


@pytest.fixture(scope="module")
def depth() -> Image:
    """Wall, floor and ball with 1 mm noise and whole millimetres, a strip of invalid pixels."""
    z = np.minimum(np.minimum(along(WALL, CAMERA.rays()), along(FLOOR, CAMERA.rays())), along(BALL, CAMERA.rays()))
    z += np.random.default_rng(1).normal(scale=1e-3, size=z.shape)
    z[:, 200:206] = np.nan
    return np.asarray(np.round(z, 3), np.float32)


def test_wall_floor_and_ball_are_found_where_they_are(depth: Image) -> None:
    found = fit_primitives(depth, CAMERA, PrimitiveConfig(stride=2, min_share=0.01))
    planes = [f.surface for f in found if isinstance(f.surface, Plane)]
    balls = [f.surface for f in found if isinstance(f.surface, Sphere)]
    for true in (WALL, FLOOR):
        nearest = planes[int(np.argmax([p.normal @ true.normal for p in planes]))]
        assert np.degrees(np.linalg.norm(np.cross(nearest.normal, true.normal))) < 0.05
        assert abs(nearest.offset - true.offset) < 0.5e-3
    assert len(balls) == 1
    assert np.linalg.norm(balls[0].centre - BALL.centre) < 1e-3
    assert abs(balls[0].radius - BALL.radius) < 1e-3


def test_what_was_seen_is_explained_to_the_noise(depth: Image) -> None:
    found = fit_primitives(depth, CAMERA, PrimitiveConfig(stride=2, min_share=0.01))
    explained = np.zeros_like(found[0].pixels)
    for f in found:
        assert f.rms < 1.2e-3
        assert not (explained & f.pixels).any()
        explained |= f.pixels
    assert explained.mean() > 0.75


def test_a_planes_mesh_is_what_was_seen_of_it(depth: Image) -> None:
    found = fit_primitives(depth, CAMERA, PrimitiveConfig(stride=2, min_share=0.01))
    wall = max((f for f in found if isinstance(f.surface, Plane)), key=lambda f: int(f.pixels.sum()))
    vertices, faces = mesh(wall, CAMERA, stride=2)
    assert isinstance(wall.surface, Plane)
    np.testing.assert_allclose(wall.surface.distance(vertices), 0.0, atol=1e-9)
    normal = np.cross(vertices[faces[:, 1]] - vertices[faces[:, 0]], vertices[faces[:, 2]] - vertices[faces[:, 0]])
    assert (normal @ wall.surface.normal > 0).all(), "faces look at the camera"
    # Each raster point the wall explains lies in a quad of it, but for the patch's rim.
    v, u = np.nonzero(wall.pixels)
    low, high = CAMERA.project(vertices).min(axis=0), CAMERA.project(vertices).max(axis=0)
    assert (np.abs([2 * u.min() - low[0], 2 * v.min() - low[1], 2 * u.max() - high[0], 2 * v.max() - high[1]]) < 8).all()


def test_a_spheres_mesh_is_round_to_a_hundredth_of_a_millimetre(depth: Image) -> None:
    found = fit_primitives(depth, CAMERA, PrimitiveConfig(stride=2, min_share=0.01))
    ball = next(f for f in found if isinstance(f.surface, Sphere))
    vertices, faces = mesh(ball, CAMERA, stride=2)
    middles = vertices[faces].mean(axis=1)
    assert np.abs(ball.surface.distance(middles)).max() < 0.05e-3


def test_a_scene_without_planes_and_spheres_is_refused() -> None:
    noise = np.random.default_rng(0).uniform(0.5, 2.0, CAMERA.shape).astype(np.float32)
    with pytest.raises(RefusedError, match="no plane and no sphere"):
        fit_primitives(noise, CAMERA)
