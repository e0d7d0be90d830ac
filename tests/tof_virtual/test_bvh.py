# SPDX-License-Identifier: Apache-2.0
"""The virtual camera's ray caster against brute force and against surfaces with a formula."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.tof_virtual.made import bench
from tof_virtual import bvh
from tof_virtual.body import soup


def brute_force(corners: np.ndarray, origin: np.ndarray, direction: np.ndarray) -> float:
    """Nearest hit by solving each triangle's 3x3 system."""
    best = np.inf
    for a, b, c in corners:
        try:
            u, v, minus_t = np.linalg.solve(np.stack([b - a, c - a, direction], axis=1), origin - a)
        except np.linalg.LinAlgError:
            continue
        if u >= 0 and v >= 0 and u + v <= 1 and minus_t < 0:
            best = min(best, -minus_t)
    return best


@settings(max_examples=8, deadline=None)
@given(st.integers(0, 10_000))
def test_first_hits_are_those_of_brute_force(seed: int) -> None:
    rng = np.random.default_rng(seed)
    corners = rng.normal(0, 1, (60, 1, 3)) + rng.normal(0, 0.4, (60, 3, 3))
    origins, directions = rng.normal(0, 2, (20, 3)), rng.normal(0, 1, (20, 3))
    t, face = bvh.build(corners).cast(origins, directions)
    expected = np.array([brute_force(corners, o, d) for o, d in zip(origins, directions, strict=True)])
    np.testing.assert_array_equal(face < 0, np.isinf(expected))
    hit = face >= 0
    np.testing.assert_allclose(t[hit], expected[hit], rtol=1e-9)


def test_a_sphere_is_met_within_its_facets() -> None:
    trimesh = pytest.importorskip("trimesh")
    ball = trimesh.creation.icosphere(subdivisions=5, radius=0.3)
    tree = bvh.build(np.asarray(ball.vertices[ball.faces]))
    rng = np.random.default_rng(1)
    inside = rng.normal(0, 1, (20_000, 3))
    t, face = tree.cast(np.zeros(3), inside / np.linalg.norm(inside, axis=1)[:, None])
    assert (face >= 0).all(), "no ray slips out between two triangles"
    assert 0.2995 < t.min() <= t.max() <= 0.3 + 1e-9


def test_rays_along_edges_and_through_corners_are_not_lost() -> None:
    steps = np.linspace(-1, 1, 5)
    grid = np.array([[x, y, 0.0] for y in steps for x in steps])
    cells = [5 * j + i for j in range(4) for i in range(4)]
    corners = grid[np.array([f for a in cells for f in ((a, a + 1, a + 6), (a, a + 6, a + 5))])]
    origin = np.array([0.1, -0.2, 3.0])
    _, face = bvh.build(corners).cast(origin, grid * 0.999 - origin)
    assert (face >= 0).all()


def test_blocked_sees_what_stands_between() -> None:
    tree = bvh.build(soup(bench()).corners)
    start = np.array([[0.5, -0.2, 0.8], [0.5, -0.5, 0.8], [0.5, -0.2, 0.8]])
    end = np.array([[-0.5, -0.2, 0.8], [0.001, -0.5, 0.8], [0.12, -0.2, 0.8]])
    np.testing.assert_array_equal(tree.blocked(start, end), [True, False, False])
