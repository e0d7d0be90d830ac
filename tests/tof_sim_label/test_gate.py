# SPDX-License-Identifier: Apache-2.0
"""Radial depth declared as z is refused with its cause; z passes, and so does depth without evidence."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tests.tof_sim_label.made import view
from tof_core.camera import Camera, z_to_radial
from tof_core.errors import RefusedError
from tof_sim_label.gate import TRIES, RadialGate

if TYPE_CHECKING:
    from tof_core.arrays import Image

CAMERA = Camera(width=160, height=120, fx=150.0, fy=150.0, cx=79.5, cy=59.5)


def plane() -> Image:
    """z-depth (H, W) of a tilted plane near 1 m with 1 mm noise."""
    rays = CAMERA.rays()
    z = 1.0 / (rays @ np.array([0.2, -0.1, 1.0]))
    return np.asarray(z + np.random.default_rng(0).normal(scale=1e-3, size=z.shape), np.float32)


def test_a_plane_as_z_passes_and_as_distance_along_the_ray_is_refused() -> None:
    blank = view(0, camera=CAMERA)
    RadialGate().check(replace(blank, depth=plane()))
    with pytest.raises(RefusedError, match=r"a plane bends: the depth looks radial.*pass --depth radial"):
        RadialGate().check(replace(blank, depth=z_to_radial(CAMERA, plane())))


def test_the_check_ends_where_nothing_is_flat() -> None:
    gate, blank = RadialGate(), view(0, camera=CAMERA)
    nothing = replace(blank, depth=np.full(CAMERA.shape, np.nan, np.float32))
    for _ in range(TRIES):
        gate.check(nothing)
    gate.check(replace(blank, depth=z_to_radial(CAMERA, plane())))


def test_once_z_is_certain_the_check_ends() -> None:
    gate, blank = RadialGate(), view(0, camera=CAMERA)
    gate.check(replace(blank, depth=plane()))
    gate.check(replace(blank, depth=z_to_radial(CAMERA, plane())))
