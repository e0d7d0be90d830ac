# SPDX-License-Identifier: Apache-2.0
"""Parts in finer faces, and scenes with other geometry."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.tof_align.made import at, box, scene_of

WALL, BLOCK = box("wall", (2.0, 1.0, 0.1), at(0.0, 0.0, 2.0)), box("block", (0.4, 0.4, 0.4), at(0.0, 0.0, 1.2))


@pytest.mark.parametrize("edge_m", [0.5, 0.13])
def test_a_divided_part_has_the_same_surface_in_faces_of_short_edges(edge_m: float) -> None:
    fine = WALL.divided(edge_m)
    corners = fine.vertices[fine.faces]
    edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    assert edges.max() <= edge_m
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum() / 2
    assert area == pytest.approx(2 * (2.0 * 1.0 + 2.0 * 0.1 + 1.0 * 0.1))
    assert (fine.name, fine.material) == (WALL.name, WALL.material)
    np.testing.assert_allclose([fine.vertices.min(axis=0), fine.vertices.max(axis=0)], [[-1, -0.5, 1.95], [1, 0.5, 2.05]])


def test_a_scene_with_another_part_in_a_place_is_another_scene() -> None:
    scene = scene_of(WALL, BLOCK)
    nearer = replace(BLOCK, vertices=BLOCK.vertices - [0.0, 0.0, 0.1])
    other = scene.replaced({1: nearer})
    assert other.parts == (WALL, nearer)
    assert other.names == scene.names
    assert other.digest != scene.digest
    assert scene.replaced({}).digest == scene.digest
