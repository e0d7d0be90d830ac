# SPDX-License-Identifier: Apache-2.0
"""z of a camera with a wrong lens, by the lens that it states or by its own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tof_core.camera import Camera
from tof_core.reasons import Reason
from tof_scene.world.seen import Seen
from tof_sim_label.world import converted

STATED = Camera(width=96, height=72, fx=70.0, fy=70.0, cx=47.5, cy=35.5)
TRUE = replace(STATED, fx=66.0, fy=66.0)
WALL_M = 1.5


def wall(depth: np.ndarray) -> Seen:
    """A wall that faces the camera, seen through the true lens."""
    shape = TRUE.shape
    noise, part = np.full(shape, 0.002, np.float32), np.zeros(shape, np.int16)
    cad, valid = np.full(shape, WALL_M, np.float32), np.full(shape, Reason.VALID, np.uint8)
    return Seen(TRUE, np.eye(4), depth.astype(np.float32), noise, cad, noise, part, valid)


@pytest.mark.parametrize("by", [STATED, TRUE])
def test_z_is_taken_along_the_rays_of_the_lens_that_distance_was_converted_by(by: Camera) -> None:
    distance = WALL_M * TRUE.ray_length()
    (found,) = converted([wall(distance / by.ray_length())], [STATED])
    assert np.abs(found.residual).max() < 1e-6
    off_m = np.abs(distance / STATED.ray_length() - WALL_M).max()
    assert off_m > 0.03, "the two differ by more than what is a foreign object"
