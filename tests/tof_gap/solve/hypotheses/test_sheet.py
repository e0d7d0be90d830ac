# SPDX-License-Identifier: Apache-2.0
"""The plane between cameras and surfaces whose region delays light most."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from tof_gap.solve.hypotheses.sheet import Sheet, sheets
from tof_gap.solve.hypotheses.sheet_score import Rays

if TYPE_CHECKING:
    from tof_core.arrays import Float, Mask

GLASS = Sheet(np.array([0.6, 0.0, 0.8]), 0.8)
"""A plane one metre before the wall z = 0, as seen from cameras two metres before it."""
FOLDS = np.arange(6)
DELAY_M = 3e-3


def rays(delay_m: float, noise: int = 3) -> Rays:
    """500 rays from each of twelve places to the wall; those that cross a square of the plane are late."""
    rng = np.random.default_rng(noise)
    places = np.column_stack([rng.uniform(-0.6, 0.6, (12, 2)), np.full(12, 2.0)])
    origin = np.repeat(places, 500, axis=0)
    point = np.column_stack([rng.uniform(-0.8, 0.8, (len(origin), 2)), np.zeros(len(origin))])
    error = late(origin, point) * delay_m + rng.normal(0.0, 1e-3, len(origin))
    return Rays(origin, point, error, np.full(len(origin), 1e6), np.repeat(np.arange(12) % 6, 500))


def late(origin: Float, point: Float) -> Mask:
    """(n,) rays that cross the plane within 0.25 m of its middle along x and y."""
    return np.asarray(np.all(np.abs(GLASS.crossings(origin, point)[:, :2]) < 0.25, axis=1))


def test_rays_cross_a_plane_between_camera_and_surface_alone() -> None:
    sheet = Sheet(np.array([0.0, 0.0, 1.0]), 1.0)
    origin = np.array([0.0, 0.0, 2.0])
    points = np.array([[2.0, 0.0, 0.0], [2.0, 0.0, 1.5], [2.0, 0.0, 2.0], [0.0, 0.0, 3.0], [np.nan] * 3])
    expected = np.array([[1.0, 0.0, 1.0], [np.nan] * 3, [np.nan] * 3, [np.nan] * 3, [np.nan] * 3])
    np.testing.assert_allclose(sheet.crossings(origin, points), expected, atol=1e-12)


def test_a_plane_within_the_camera_is_crossed_by_no_ray() -> None:
    sheet = Sheet(np.array([0.0, 0.0, 1.0]), 1.97)
    assert np.isnan(sheet.crossings(np.array([0.0, 0.0, 2.0]), np.zeros((1, 3)))).all()


def test_a_turned_plane_keeps_the_point_that_it_turns_about() -> None:
    about = np.array([0.2, -0.3, 1.1])
    turned = GLASS.turned(about, np.array([0.0, 0.1, 0.0]), 0.0)
    assert np.linalg.norm(turned.normal) == pytest.approx(1.0)
    assert about @ turned.normal == pytest.approx(turned.offset_m)
    assert GLASS.turned(about, np.zeros(3), 0.05).offset_m == pytest.approx(about @ GLASS.normal + 0.05)


def test_the_plane_of_a_pane_is_found_for_each_fold_by_the_rays_of_the_others() -> None:
    seen = rays(DELAY_M)
    found = sheets(seen, FOLDS)
    assert set(found) == set(FOLDS.tolist())
    crossing = GLASS.crossings(seen.origin, seen.point)[late(seen.origin, seen.point)]
    for sheet in found.values():
        assert np.abs(crossing @ sheet.normal - sheet.offset_m).max() < 0.15
        assert sheet.normal @ GLASS.normal > np.cos(np.radians(35))


def test_no_plane_without_rays() -> None:
    nothing = Rays(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0), np.zeros(0), np.zeros(0, np.int64))
    assert sheets(nothing, FOLDS) == {}
