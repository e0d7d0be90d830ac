# SPDX-License-Identifier: Apache-2.0
"""Residuals and Jacobians against rendering again; which pixels take part."""

from __future__ import annotations

import numpy as np
import pytest

from tests.tof_align.made import CONFIG, at, box, look, measured, one_view, scene_of, section
from tof_align.linearise import Linearised, linearise
from tof_align.pixels import take_pixels
from tof_core import se3
from tof_core.capture import RobotPose
from tof_scene.raycast import Raycaster


def seen_from(T: np.ndarray, error: np.ndarray) -> Linearised:
    view, _ = one_view(section(), np.zeros(6))
    return linearise(take_pixels(view, CONFIG.weights), T @ se3.exp(error), section(), CONFIG.weights)


@pytest.mark.parametrize("axis", range(6))
def test_the_jacobian_is_how_rendered_z_changes_with_the_cameras_pose(axis: int) -> None:
    T = one_view(section(), np.zeros(6))[1].T_cell_camera
    step = 1e-5 * np.eye(6)[axis]
    here, plus, minus = (seen_from(T, e) for e in (np.zeros(6), step, -step))
    common = np.intersect1d(np.intersect1d(here.index, plus.index), minus.index)
    pick = [np.isin(v.index, common) for v in (here, plus, minus)]
    numeric = (plus.depth[pick[1]] - minus.depth[pick[2]]) / 2e-5
    same_face = np.einsum("ij,ij->i", plus.normal[pick[1]], minus.normal[pick[2]]) > 0.999
    assert same_face.mean() > 0.99
    analytic = here.jacobian[pick[0], axis]
    np.testing.assert_allclose(numeric[same_face], analytic[same_face], rtol=2e-3, atol=2e-4)


def test_the_residual_is_measured_minus_rendered() -> None:
    view, truth = one_view(section(), np.zeros(6), effect=lambda seen: 0.005 + 0 * seen.depth)
    lin = linearise(take_pixels(view, CONFIG.weights), truth.T_cell_camera, section(), CONFIG.weights)
    assert np.median(lin.residual) == pytest.approx(0.005, abs=5e-5)
    np.testing.assert_allclose(lin.depth, truth.depth.ravel()[lin.index], atol=1e-9)


def test_edges_and_grazing_pixels_are_left_out() -> None:
    T = look(np.array([0.8, 0.0, 0.8]), np.array([0.0, 0.0, 0.8]))
    caster = Raycaster(scene_of(box("wall", (0.02, 2, 2), at(0, 0, 0.8)), box("step", (0.4, 0.2, 0.2), at(0, 0.01, 0.8))))
    view, _ = measured(caster, T, RobotPose(np.eye(4), T))
    lin = linearise(take_pixels(view, CONFIG.weights), T, caster, CONFIG.weights)
    assert set(np.round(lin.depth, 2)) <= {0.6, 0.79}
    facing = np.abs(np.einsum("ij,ij->i", lin.normal, lin.ray @ T[:3, :3].T)) / lin.ray_length
    assert facing.min() > np.cos(np.radians(CONFIG.weights.grazing_deg))
    h, w = lin.raster
    near = np.full((h, w), np.nan)
    near.ravel()[lin.cell] = lin.depth
    assert np.nanmax(np.abs(np.diff(near, axis=1))) < 0.01


def test_invalid_pixels_do_not_take_part() -> None:
    view, truth = one_view(section(), np.zeros(6))
    view.depth[10:40, 20:60] = np.nan
    lin = linearise(take_pixels(view, CONFIG.weights), truth.T_cell_camera, section(), CONFIG.weights)
    rows, cols = np.divmod(lin.index, view.camera.width)
    assert not ((rows >= 10) & (rows < 40) & (cols >= 20) & (cols < 60)).any()
    assert np.isfinite(lin.residual).all()
