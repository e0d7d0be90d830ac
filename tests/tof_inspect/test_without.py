# SPDX-License-Identifier: Apache-2.0
"""The scene without a part, from two trees, is the scene that was made without it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.tof_align.made import at, box, scene_of
from tests.tof_inspect.made import CAMERA, EYE, plate
from tof_inspect.without import Split
from tof_scene.raycast import Raycaster

RAYS = CAMERA.rays().reshape(-1, 3) @ EYE[:3, :3].T


@pytest.mark.parametrize("name", ["clip", "block", "buried", "behind"])
def test_rays_go_on_behind_the_part(name: str) -> None:
    scene = plate()
    found = Split(scene).without(scene.index(name)).cast(EYE[:3, 3], RAYS)
    bare = scene.without(name)
    made = Raycaster(bare).cast(EYE[:3, 3], RAYS)
    np.testing.assert_allclose(found.t, made.t, atol=1e-6)
    numbers = np.array([*(scene.index(p.name) for p in bare.parts), -1])
    np.testing.assert_array_equal(found.part, numbers[made.part])
    hit = found.part >= 0
    np.testing.assert_allclose(found.normal[hit], made.normal[hit], atol=1e-9)


def test_what_a_part_lies_on_face_to_face_is_seen_when_it_is_gone() -> None:
    scene = scene_of(
        box("sheet", (0.001, 0.4, 0.4), at(0, 0, 0.8)), replace(box("tile", (0.01, 0.1, 0.1), at(0.0055, 0, 0.8)), inspect=True)
    )
    t = Split(scene).without(1).cast(np.array([0.5, 0.0, 0.8]), np.array([[-1.0, 0.0, 0.0]])).t
    np.testing.assert_allclose(t, 0.4995, atol=1e-6)


def test_a_scene_of_inspected_parts_alone() -> None:
    scene = scene_of(replace(box("tile", (0.01, 0.1, 0.1), at(0, 0, 0.8)), inspect=True))
    assert np.isnan(Split(scene).without(0).cast(EYE[:3, 3], RAYS).t).all()
