# SPDX-License-Identifier: Apache-2.0
"""Renderings against surfaces with a formula: plane, sphere, cylinder, corner, each within 0.01 mm."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from tests.tof_scene.solids import ball, bar, bar_depth, block, camera, looking, rays_in_cell, scene, sphere_depth, wall
from tof_core.errors import TransformError
from tof_scene.builtin.shapes import join
from tof_scene.raycast import Raycaster
from tof_scene.render import render, thinned

if TYPE_CHECKING:
    from collections.abc import Callable

    from tof_core.arrays import Float
    from tof_core.camera import Camera

EYE = (1.0, 0.15, 0.2)
BALL, BAR = Raycaster(scene(ball=ball(0.06, 500))), Raycaster(scene(bar=bar(0.1)))


def test_a_plane_is_exact() -> None:
    T, cam = looking(EYE, (0, 0, 0)), camera()
    view = render(Raycaster(scene(wall=wall())), cam, T, footprints=False)
    rays = rays_in_cell(cam, T)
    assert np.abs(view.depth + T[0, 3] / rays[..., 0]).max() < 2e-7  # float32's half step at 1 to 2 m
    assert np.allclose(view.normal @ T[:3, :3].T, [1, 0, 0], atol=1e-6)
    assert np.allclose(view.incidence, np.arccos(-rays[..., 0] / np.linalg.norm(rays, axis=-1)), atol=1e-6)
    assert (view.part == 0).all()
    assert np.allclose(view.albedo, 0.1)


@pytest.mark.parametrize("how", ["centres", "footprints"])
def test_a_sphere_is_within_a_hundredth_of_a_millimetre(how: str) -> None:
    """The mesh itself (500 segments) lies up to 0.002 mm inside; toward the limb that counts more along the ray."""
    T, cam = looking(EYE, (0, 0, 0)), camera(120, 90, 10)
    view = render(BALL, cam, T, footprints=how == "footprints")
    truth = finely(lambda fine: sphere_depth(fine, T, 0.06), cam) if how == "footprints" else sphere_depth(cam, T, 0.06)
    whole = np.isfinite(truth) & (np.degrees(view.incidence) < 70)
    assert whole.sum() > 2000
    assert np.abs(view.depth - truth)[whole].max() < 1e-5


@pytest.mark.parametrize("how", ["centres", "footprints"])
def test_a_cylinder_is_within_a_hundredth_of_a_millimetre(how: str) -> None:
    T, cam = looking(EYE, (0, 0, 0)), camera(120, 90, 40)
    view = render(BAR, cam, T, footprints=how == "footprints")
    truth = finely(lambda fine: bar_depth(fine, T, 0.1), cam) if how == "footprints" else bar_depth(cam, T, 0.1)
    whole = np.isfinite(truth) & (np.degrees(view.incidence) < 70)
    assert whole.sum() > 2000
    assert np.abs(view.depth - truth)[whole].max() < 1e-5


def test_a_corner_of_three_walls_is_within_a_hundredth_of_a_millimetre_on_average_over_each_pixel() -> None:
    """Concave: the nearest of three planes behind which all is solid; creases run through many pixels."""
    corner = join(wall(), block(0, -0.05, 0, (8, 0.1, 8)), block(0, 0, -0.05, (8, 8, 0.1)))
    T, cam = looking((1.0, 0.8, 0.7), (0, 0, 0)), camera(60, 44, 10)
    view = render(Raycaster(scene(corner=corner)), cam, T)

    def truth(fine: Camera) -> Float:
        with np.errstate(divide="ignore"):
            t = -T[:3, 3] / rays_in_cell(fine, T)
        return np.asarray(np.where(t > 0, t, np.inf).min(axis=-1))

    assert np.abs(view.depth - finely(truth, cam, 32)).max() < 1e-5
    assert (view.mixed == 0).all()


def finely(depth: Callable[[Camera], Float], cam: Camera, n: int = 16) -> Float:
    """Mean of a formula over n x n points in each pixel, NaN where any of them has none."""
    fine = depth(cam.scaled(n))
    return np.asarray(fine.reshape(cam.height, n, cam.width, n).mean(axis=(1, 3)))


def test_a_distorted_lens_sees_the_same_plane_along_its_own_rays() -> None:
    lens = camera(distortion=(-0.28, 0.09, 0.001, -0.0007, 0.0), distortion_model="plumb_bob")
    T = looking(EYE, (0, 0, 0))
    caster = Raycaster(scene(wall=wall(), cube=block(0.1, 0, 0, (0.2, 0.2, 0.2))))
    view = render(caster, lens, T)
    plain = render(caster, lens, T, footprints=False)
    flat = (view.mixed == 0) & (view.part == 0)
    truth = -T[0, 3] / rays_in_cell(lens, T)[..., 0]
    assert np.abs(plain.depth - truth)[plain.part == 0].max() < 2e-7
    assert np.abs(view.depth - truth)[flat].max() < 1e-5
    assert (view.mixed > 0).sum() > 40


def test_pixels_beyond_the_lens_field_are_void_and_the_others_are_not() -> None:
    lens = camera(fov_deg=100, distortion=(-0.45, 0.0, 0.0, 0.0, 0.0), distortion_model="plumb_bob")
    outside = ~np.isfinite(lens.rays()).all(axis=-1)
    assert 0.01 < outside.mean() < 0.9
    view = render(Raycaster(scene(wall=wall(), cube=block(0.1, 0, 0, (0.2, 0.2, 0.2)))), lens, looking(EYE, (0, 0, 0)))
    assert np.array_equal(np.isnan(view.depth), outside)
    assert np.array_equal(view.part == -1, outside)


def test_what_hits_nothing_is_void_everywhere() -> None:
    cam = camera(20, 10)
    view = render(Raycaster(scene(cube=block(0, 0, 0, (0.1, 0.1, 0.1)))), cam, looking((1, 0, 0), (2, 0, 0)))
    assert np.isnan(view.depth).all()
    assert (view.part == -1).all()
    assert (view.face == -1).all()
    assert np.isnan(view.albedo).all()
    assert (view.mixed == 0).all()


def test_step_takes_every_nth_ray_of_the_full_raster() -> None:
    caster, cam, T = Raycaster(scene(ball=ball(0.3, 200))), camera(81, 61), looking(EYE, (0, 0, 0))
    full, thin = (render(caster, cam, T, footprints=False, step=s) for s in (1, 4))
    assert thin.camera == thinned(cam, 4)
    assert np.array_equal(thin.face, full.face[::4, ::4])
    assert np.allclose(thin.depth, full.depth[::4, ::4], atol=2e-7, equal_nan=True)


def test_rendering_is_the_same_each_time() -> None:
    caster, cam, T = Raycaster(scene(ball=ball(0.2, 100), wall=wall(-0.5))), camera(), looking(EYE, (0, 0, 0))
    one, two = render(caster, cam, T), render(caster, cam, T)
    for field in ("depth", "part", "face", "normal", "mixed", "second"):
        assert np.array_equal(getattr(one, field), getattr(two, field), equal_nan=field != "part")


def test_a_pose_that_is_no_rigid_motion_is_refused() -> None:
    with pytest.raises(TransformError, match="camera pose"):
        render(Raycaster(scene(wall=wall())), camera(), np.diag([2.0, 1, 1, 1]))
