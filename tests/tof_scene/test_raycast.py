# SPDX-License-Identifier: Apache-2.0
"""Rays: exact on planes, both sides of a face, no ray lost at a mesh edge, the two libraries agree."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.tof_scene.solids import ball, block, scene, wall
from tof_core.errors import UsageError
from tof_scene.builtin import make_builtin
from tof_scene.raycast import Raycaster

coordinate = st.floats(-1.0, 1.0)


def test_a_hit_has_distance_part_face_and_normal_toward_the_origin() -> None:
    caster = Raycaster(scene(wall=wall(), cube=block(0.3, 0, 0, (0.2, 0.2, 0.2))))
    hits = caster.cast((2.0, 0.0, 0.0), [(-2.0, 0.01, 0.02), (-1.0, 0.5, 0.0), (1.0, 0.0, 0.0)])
    assert hits.part.tolist() == [1, 0, -1]
    assert hits.t[:2] == pytest.approx([0.8, 2.0], abs=1e-12)
    assert np.isnan(hits.t[2])
    assert hits.face[2] == -1
    assert np.allclose(hits.normal[:2], [[1, 0, 0], [1, 0, 0]], atol=1e-12)
    assert caster.face_part[hits.face[:2]].tolist() == [1, 0]


def test_a_face_is_seen_from_behind_with_its_normal_turned() -> None:
    sheet = (np.array([[0.0, -1, -1], [0, 1, -1], [0, 0, 1]]), np.array([[0, 1, 2]]))
    caster = Raycaster(scene(sheet=sheet))
    hits = caster.cast([(1.0, 0, 0), (-1.0, 0, 0)], [(-1.0, 0, 0), (1.0, 0, 0)])
    assert hits.t == pytest.approx([1.0, 1.0])
    assert np.allclose(hits.normal, [[1, 0, 0], [-1, 0, 0]])


def test_distance_is_float64_even_far_from_the_origin() -> None:
    far = np.array([1000.0, -2000.0, 500.0])
    solid = wall(1 / 3)
    caster = Raycaster(scene(wall=(solid[0] + far, solid[1])))
    hits = caster.cast(far + np.array([1.0, 0.1, 0.2]), [(-1.0, 0.0, 0.0)])
    assert hits.t[0] == pytest.approx(2 / 3, abs=1e-12)


def test_no_ray_is_lost_between_the_triangles_of_a_closed_mesh() -> None:
    solid = ball(0.3, 60)
    corners = np.unique(np.round(solid[0], 9), axis=0)
    middles = solid[0][solid[1][:, [0, 1]]].mean(axis=1)  # rays aimed at vertices and at edges, where cracks would be
    aims = np.concatenate([corners, middles])
    hits = Raycaster(scene(ball=solid)).cast((0.0, 0.0, 0.0), aims)
    assert np.isfinite(hits.t).all()
    assert np.abs(hits.t - 1).max() < 1e-6


def test_rays_keep_their_order_when_some_are_cast_again() -> None:
    caster = Raycaster(scene(wall=block(0, 0, 0, (0.1, 1.0, 1.0))))
    y = np.linspace(-1, 1, 101)
    hits = caster.cast((1.05, 0.0, 0.0), np.stack([-np.ones(101), y, np.zeros(101)], 1))
    assert np.array_equal(np.isfinite(hits.t), np.abs(y) <= 0.5)


@given(st.tuples(coordinate, coordinate, coordinate), st.tuples(coordinate, coordinate, coordinate))
def test_moving_scene_and_rays_together_changes_nothing(shift: tuple[float, ...], aim: tuple[float, ...]) -> None:
    solid = block(0, 0, 0, (0.5, 0.4, 0.3))
    at = np.array([2.0, 0.3, 0.4])
    here = Raycaster(scene(cube=solid)).cast(at, [np.array(aim) * 0.3 - at])
    there = Raycaster(scene(cube=(solid[0] + shift, solid[1]))).cast(at + shift, [np.array(aim) * 0.3 - at])
    assert here.part.tolist() == there.part.tolist() or np.isclose(np.abs(aim).max() * 0.3, [0.15, 0.2, 0.25], atol=1e-3).any()
    assert np.allclose(here.t, there.t, atol=1e-9, equal_nan=True)


def test_embree_and_open3d_agree_on_a_whole_scene() -> None:
    pytest.importorskip("open3d", reason="the second ray caster is not installed")
    cell = make_builtin("housing")
    rng = np.random.default_rng(5)
    aims = rng.uniform((-0.3, -0.4, 0.5), (0.2, 0.4, 1.1), (20000, 3))
    eye = np.array([1.0, 0.2, 0.9])
    one, other = (Raycaster(cell, name).cast(eye, aims - eye) for name in ("embree", "open3d"))
    same = np.abs(one.t - other.t) < 1e-9
    assert (same | (np.isnan(one.t) & np.isnan(other.t))).mean() > 0.9995  # rays that graze an edge may take either side
    assert (one.part == other.part).mean() > 0.9995


@pytest.mark.parametrize("backend", ["embree", "open3d"])
@pytest.mark.parametrize("reach", [0.8, 0.9, 1.1])
def test_a_ray_is_blocked_where_the_first_hit_lies_within_its_reach(backend: str, reach: float) -> None:
    pytest.importorskip("embreex" if backend == "embree" else backend, reason="this ray caster is not installed")
    caster = Raycaster(make_builtin("housing"), backend)
    aims = np.random.default_rng(6).uniform((-0.3, -0.4, 0.5), (0.2, 0.4, 1.1), (20000, 3))
    eye = np.array([1.0, 0.2, 0.9])
    t = caster.cast(eye, aims - eye).t
    sure = ~(np.abs(t - reach) < 1e-5)
    blocked = caster.blocked(eye, aims - eye, reach)
    assert 0.05 < blocked.mean() < 1.0
    assert (blocked == (t < reach))[sure].mean() > 0.9995  # rays that graze an edge may take either side
    between = caster.blocked_between(eye[None], aims, np.zeros(len(aims), np.int32), np.arange(len(aims), dtype=np.int32), reach)
    np.testing.assert_array_equal(between, blocked)


def test_an_unknown_backend_is_a_wrong_call() -> None:
    with pytest.raises(UsageError, match="there is no ray caster 'optix'"):
        Raycaster(scene(wall=wall()), "optix")
