# SPDX-License-Identifier: Apache-2.0
"""Objects that end in a step, seen from before and from the side."""

from __future__ import annotations

import numpy as np
import pytest

from tof_core.camera import Camera
from tof_scene.world.lying import ends_in_a_step, most_end_in_a_step
from tof_scene.world.seen import Seen

CAMERA = Camera(width=60, height=40, fx=60.0, fy=60.0, cx=29.5, cy=19.5)
WALL_M, SLAB_M = 1.0, 0.032


def view(cad: np.ndarray) -> Seen:
    """A view of one part with this depth in the CAD."""
    unsure, part = np.full(CAMERA.shape, 1e-3, np.float32), np.zeros(CAMERA.shape, np.int16)
    return Seen(CAMERA, np.eye(4), cad.astype(np.float32), unsure, cad.astype(np.float32), unsure, part, np.zeros(CAMERA.shape, np.uint8))


def from_before(height: np.ndarray | float = SLAB_M) -> tuple[Seen, np.ndarray, np.ndarray]:
    """A patch of 16 by 20 pixels that stands out of a wall."""
    at = np.zeros(CAMERA.shape, bool)
    at[12:28, 20:40] = True
    wall = np.full(CAMERA.shape, WALL_M)
    return view(wall), wall - np.where(at, height, 0.0), at


def from_the_side() -> tuple[Seen, np.ndarray, np.ndarray]:
    """A strip of 8 pixels, 1 m away, before a ledge 0.1 m behind and, at its upper quarter, a wall 0.8 m behind."""
    at = np.zeros(CAMERA.shape, bool)
    at[8:32, 26:34] = True
    behind = np.full(CAMERA.shape, WALL_M + 0.1)
    behind[:14] = WALL_M + 0.8
    return view(behind), np.where(at, WALL_M, behind), at


@pytest.mark.parametrize(("beyond_m", "is_object"), [(np.inf, False), (0.04, True)])
def test_a_slab_that_most_views_see_from_the_side_is_far_before_what_lies_behind(beyond_m: float, *, is_object: bool) -> None:
    assert ends_in_a_step(*from_before(), on_a_part=False)
    assert not ends_in_a_step(*from_the_side(), on_a_part=False)
    assert most_end_in_a_step([from_before(), from_the_side(), from_the_side()], on_a_part=False, beyond_m=beyond_m) is is_object


def test_a_bump_ends_in_no_step_however_many_views_show_it() -> None:
    row, column = np.indices(CAMERA.shape)
    bump = SLAB_M * np.maximum(1.0 - ((row - 19.5) / 8) ** 2 - ((column - 29.5) / 10) ** 2, 0.0)
    assert not most_end_in_a_step([from_before(bump)] * 3, on_a_part=False, beyond_m=0.04)
