# SPDX-License-Identifier: Apache-2.0
"""Planes seen in pieces distinguish z from radial distance; surfaces that are not flat give no result."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from benchmarks.radial import z_to_radial
from tof_core.camera import Camera
from tof_core.flat.wide_plane import wide_bend

if TYPE_CHECKING:
    from tof_core.arrays import Float, Image

CAMERA = Camera(width=224, height=171, fx=140.0, fy=140.0, cx=111.5, cy=85.0)


def noisy(z: Float, scale: float = 2e-3) -> Image:
    """With noise, in whole millimetres."""
    return np.round(z + np.random.default_rng(3).normal(scale=scale, size=z.shape), 3).astype(np.float32)


def table() -> Image:
    """Strips of a table to both sides of a round pot, and nothing else."""
    rays = CAMERA.rays()
    with np.errstate(divide="ignore"):
        z = np.where(rays[..., 1] > 0.15, 0.12 / rays[..., 1], np.nan)
    return noisy(np.where(np.abs(rays[..., 0]) < 0.2, np.nan, z))


def ball(radius: float, distance: float) -> Image:
    """A ball on the optical axis, by the textbook formula."""
    rays = CAMERA.rays()
    a, b, c = (rays**2).sum(-1), rays[..., 2] * distance, distance**2 - radius**2
    root = b * b - a * c
    return noisy(np.where(root > 0, (b - np.sqrt(np.maximum(root, 0))) / a, np.nan))


def test_a_table_in_two_pieces_is_evidence_for_z_and_for_radial() -> None:
    z, radial = wide_bend(table(), CAMERA), wide_bend(z_to_radial(CAMERA, table()), CAMERA)
    assert z is not None
    assert radial is not None
    assert (z.radial, radial.radial) == (False, True)
    assert min(z.metres, radial.metres) > 8e-3
    assert min(z.share, radial.share) > 0.7


@pytest.mark.parametrize(("radius", "distance"), [(0.1, 0.8), (0.2, 1.0), (0.3, 1.0)])
def test_a_sphere_is_no_evidence(radius: float, distance: float) -> None:
    assert wide_bend(ball(radius, distance), CAMERA) is None


def test_few_pixels_are_no_evidence() -> None:
    few = np.full(CAMERA.shape, np.nan, np.float32)
    few[10:14, 10:14] = 1.0
    assert wide_bend(few, CAMERA) is None
