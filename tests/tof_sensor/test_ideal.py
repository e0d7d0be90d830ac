# SPDX-License-Identifier: Apache-2.0
"""Normals, incidence and mixed pixels of an ideal depth image, against the scene that was rendered."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from tof_core.camera import Camera
from tof_scene.raycast import Raycaster
from tof_scene.render import render
from tof_scene.scene import Material, Part, Scene
from tof_sensor.ideal import completed, imaged

if TYPE_CHECKING:
    from tof_core.arrays import Float

CAMERA = Camera(80, 60, 75.0, 76.0, 39.2, 30.1, distortion=(0.1, -0.05, 1e-3, -1e-3, 0.0))


def square(name: str, z: float, half: float, albedo: float) -> Part:
    """A square across the optical axis, tilted about y."""
    corners = np.array(
        [[-half, -half, z - 0.3 * half], [half, -half, z + 0.3 * half], [half, half, z + 0.3 * half], [-half, half, z - 0.3 * half]]
    )
    return Part(name, corners, np.array([[0, 2, 1], [0, 3, 2]], np.int32), Material(albedo=albedo))


SCENE = Scene("cell", (square("near", 0.8, 0.15, 0.9), square("far", 1.3, 1.5, 0.3)))


@pytest.fixture(scope="module")
def caster() -> Raycaster:
    """A small square before a large one."""
    return Raycaster(SCENE)


def borders(seed: int = 0) -> Float:
    return np.random.default_rng(seed).random((2, *CAMERA.shape))


def test_normals_and_incidence_are_those_of_the_planes(caster: Raycaster) -> None:
    ideal = render(caster, CAMERA, np.eye(4), footprints=False)
    seen = imaged(CAMERA, ideal.depth, borders())
    error = np.degrees(np.arccos(np.clip(np.einsum("hwi,hwi->hw", seen.normal, ideal.normal), -1, 1)))
    assert np.nanquantile(error, 0.95) < 0.2
    np.testing.assert_allclose(np.nanmedian(np.abs(seen.incidence - ideal.incidence)), 0, atol=1e-3)


def test_given_normals_are_taken_and_turned_to_the_camera(caster: Raycaster) -> None:
    ideal = render(caster, CAMERA, np.eye(4), footprints=False)
    seen = imaged(CAMERA, ideal.depth, borders(), normal=-ideal.normal)
    np.testing.assert_allclose(seen.normal, ideal.normal, atol=1e-6)
    np.testing.assert_allclose(seen.incidence, ideal.incidence, atol=1e-3)


def test_edges_are_mixed_as_often_and_as_much_as_footprints_are(caster: Raycaster) -> None:
    ideal, sharp = render(caster, CAMERA, np.eye(4)), render(caster, CAMERA, np.eye(4), footprints=False)
    seen = imaged(CAMERA, sharp.depth, borders())
    true, made = ideal.mixed > 0.02, seen.mixed > 0.02
    assert made.sum() == pytest.approx(true.sum(), rel=0.3)
    assert seen.mixed[made].mean() == pytest.approx(ideal.mixed[true].mean(), abs=0.06)
    step = np.abs(seen.second - sharp.depth)[made]
    assert 0.2 < step.min() < step.max() < 0.8
    assert not seen.mixed[np.isnan(seen.second)].any()


def test_a_plane_alone_has_no_edge_and_void_is_no_second_surface() -> None:
    one = Raycaster(Scene("cell", SCENE.parts[:1]))
    sharp = render(one, CAMERA, np.eye(4), footprints=False)
    assert not imaged(CAMERA, sharp.depth, borders()).mixed.any()


def test_the_scene_completes_what_it_knows_and_leaves_the_rest(caster: Raycaster) -> None:
    scene = render(caster, CAMERA, np.eye(4))
    depth = render(caster, CAMERA, np.eye(4), footprints=False).depth.copy()
    depth[:10] = 0.5
    whole = completed(imaged(CAMERA, depth, borders(), albedo=np.full(CAMERA.shape, 0.7, np.float32)), scene)
    assert (whole.part[:10] == -1).all()
    np.testing.assert_allclose(whole.albedo[:10], 0.7)
    inside = np.abs(depth - scene.depth) < 1e-4
    inside[:10] = False
    np.testing.assert_array_equal(whole.part[inside], scene.part[inside])
    np.testing.assert_array_equal(whole.albedo[inside], scene.albedo[inside])
    np.testing.assert_array_equal(whole.depth, depth)
