# SPDX-License-Identifier: Apache-2.0
"""Edges and concavity per pixel, and regions per face."""

from __future__ import annotations

import numpy as np
import pytest

from tests.tof_scene.solids import block, camera, looking, scene, wall
from tof_scene.builtin.shapes import cylinder
from tof_scene.maps import concavity, concavity_map, edge_distance, edge_mask
from tof_scene.raycast import Raycaster
from tof_scene.render import render

FRONT = looking((1.0, 0.0, 0.0), (0.0, 0.0, 0.0))


def test_concavity_of_a_wall_is_zero_and_of_a_right_angle_one_half() -> None:
    caster = Raycaster(scene(a=wall(), b=block(0.5, 0.05, 0, (1.0, 0.1, 8.0))))
    x = np.array([[0.0, -1.0, 0.0], [0.0, -1e-3, 0.0]])
    values = concavity(caster, x, np.array([[1.0, 0, 0], [1.0, 0, 0]]), rays=400)
    assert values == pytest.approx([0.0, 0.5], abs=0.02)


def test_concavity_at_the_bottom_of_a_deep_narrow_hole_is_nearly_one() -> None:
    walls = [block(0.1, s * 0.03, 0, (0.2, 0.02, 0.08)) for s in (-1, 1)] + [block(0.1, 0, s * 0.03, (0.2, 0.08, 0.02)) for s in (-1, 1)]
    caster = Raycaster(scene(floor=wall(), a=walls[0], b=walls[1], c=walls[2], d=walls[3]))
    deep = concavity(caster, np.zeros((1, 3)), np.array([[1.0, 0, 0]]), rays=400)
    assert deep[0] > 0.98


def test_the_map_gives_each_pixel_its_own_parts_value() -> None:
    cam = camera(60, 44)
    caster = Raycaster(scene(back=wall(-0.1), plate=block(-0.005, 0.5, 0, (0.01, 1.0, 3.0))))
    view = render(caster, cam, FRONT)
    values = concavity_map(caster, view, stride=4)
    assert values[view.part == 1].max() == 0
    behind = values[(view.part == 0) & (np.arange(60) > 26)]
    assert behind.min() > 0.1
    assert values[:, :4].max() < 0.1


def test_void_has_no_concavity() -> None:
    caster = Raycaster(scene(cube=block(0, 0, 0, (0.3, 0.3, 0.3))))
    view = render(caster, camera(40, 30), FRONT)
    values = concavity_map(caster, view)
    assert np.array_equal(np.isnan(values), np.isnan(view.depth))
    assert np.nanmax(values) == 0


def test_edges_are_counted_in_pixels_from_the_boundary_between_parts() -> None:
    cam = camera(40, 30)
    y = (20.0 - cam.cx) / cam.fx
    view = render(Raycaster(scene(back=wall(-0.5), plate=block(-5e-4, y - 1.0, 0, (1e-3, 2.0, 2.0)))), cam, FRONT)
    distance = edge_distance(view)
    assert edge_mask(view)[15].nonzero()[0].tolist() in ([19, 20], [20, 21], [19, 20, 21])
    assert distance[15, 20] == 0
    assert distance[15, 0] == pytest.approx(20, abs=1)
    assert np.isinf(edge_distance(render(Raycaster(scene(back=wall())), cam, FRONT))).all()


def test_regions_are_the_smooth_patches_of_each_part() -> None:
    cell = scene(cube=block(0, 0, 0, (1, 1, 1)), rod=cylinder(0.1, 1.0, 96), other=block(1, 0, 0, (1, 1, 1)))
    regions, part = cell.surface_regions(), cell.triangles()[2]
    assert len(np.unique(regions[part == 0])) == 6
    assert len(np.unique(regions[part == 1])) == 5  # two ends, two broken edges, one shell
    assert not set(regions[part == 0]) & set(regions[part == 2])
