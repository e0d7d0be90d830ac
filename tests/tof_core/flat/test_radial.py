# SPDX-License-Identifier: Apache-2.0
"""z or distance along the ray: flat surfaces decide it wherever they lie in the image, and nothing else does."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from benchmarks.radial import z_to_radial
from tof_core.bag import BagOptions, open_bag
from tof_core.camera import Camera
from tof_core.flat.radial import radial_evidence

if TYPE_CHECKING:
    from pathlib import Path

    from tof_core.arrays import Float, Image

CAMERA = Camera(width=224, height=171, fx=210.0, fy=210.0, cx=111.5, cy=85.0)
BAGS = ["real/azure_kinect_static/bag", "real/azure_kinect_nfov/bag", "cases/example_null/bag", "cases/example_wiggling/bag"]
"""Cameras that give z. (Of the radial one's flat parts only strips are seen: tests/tof_sim_label/test_real.py.)"""


def noisy(z: Float, scale: float = 2e-3) -> Image:
    """With noise, in whole millimetres."""
    return np.round(z + np.random.default_rng(3).normal(scale=scale, size=z.shape), 3).astype(np.float32)


def room() -> Float:
    """A box before a wall, on a table of which only the strips to both sides are seen."""
    rays = CAMERA.rays()
    wall = 1.4 / (rays @ np.array([0.3, 0.0, 1.0]))
    with np.errstate(divide="ignore"):
        table = np.where(rays[..., 1] > 0.05, 0.25 / rays[..., 1], np.inf)
    box = np.where((np.abs(rays[..., 0]) < 0.15) & (rays[..., 1] > -0.1), 0.7, np.inf)
    return np.asarray(np.minimum(np.minimum(wall, table), box))


def test_z_and_radial_are_distinguished_and_the_bend_is_reported() -> None:
    depth = noisy(room())
    assert radial_evidence(depth, CAMERA).suspicion < 0.01
    assert radial_evidence(z_to_radial(CAMERA, depth), CAMERA).suspicion > 0.99


def test_a_surface_in_two_pieces_is_one_plane() -> None:
    depth = noisy(room())
    depth[:120] = np.nan  # no wall: the table to both sides of the box, and its foot
    assert radial_evidence(depth, CAMERA).suspicion < 0.01
    assert radial_evidence(z_to_radial(CAMERA, depth), CAMERA).suspicion > 0.99


def test_a_sphere_alone_is_weak_evidence() -> None:
    rays = CAMERA.rays()
    a, b, c = (rays**2).sum(-1), rays[..., 2] * 1.0, 1.0 - 0.3**2
    root = b * b - a * c
    ball = np.where(root > 0, (b - np.sqrt(np.maximum(root, 0))) / a, np.nan)
    assert 0.005 < radial_evidence(noisy(ball), CAMERA).suspicion < 0.995


def test_a_lens_without_rays_in_the_corners_is_survived() -> None:
    runaway = replace(CAMERA, distortion=(0.095, -0.75, -0.004, 0.005, 0.0))
    assert np.isnan(runaway.rays()).any()
    found = radial_evidence(noisy(room()), runaway)
    assert np.isfinite(found.exponent)
    assert found.planes > 0


def test_few_pixels_or_none_are_no_evidence() -> None:
    none = np.full(CAMERA.shape, np.nan, np.float32)
    assert radial_evidence(none, CAMERA).suspicion == 0.5
    none[10:14, 10:14] = 1.0
    assert radial_evidence(none, CAMERA).suspicion == 0.5


@pytest.mark.shared
@pytest.mark.parametrize("bag", BAGS)
def test_real_and_foreign_cameras_are_classified(shared_data: Path, bag: str) -> None:
    with open_bag(shared_data / bag, BagOptions()) as reader:
        for capture in list(reader.captures(need_tf=False))[:2]:
            assert radial_evidence(capture.depth, capture.camera).suspicion < 0.01
            assert radial_evidence(z_to_radial(capture.camera, capture.depth), capture.camera).suspicion > 0.99
