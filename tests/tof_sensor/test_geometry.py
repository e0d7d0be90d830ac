# SPDX-License-Identifier: Apache-2.0
"""First-order columns against the exact depth of a moved plane."""

from __future__ import annotations

import numpy as np
import pytest

from tests.tof_sensor.plane import CAMERA, NORMAL, OFFSET, plane_depth, plane_frame
from tof_core import se3
from tof_core.camera import Camera
from tof_sensor.effects.intrinsics import Intrinsics
from tof_sensor.geometry import beside_poses, pose_columns

STEP = 1e-5


@pytest.mark.parametrize("axis", range(6))
def test_pose_column_is_the_derivative_of_depth(axis: int) -> None:
    xi = np.zeros(6)
    xi[axis] = STEP
    T = se3.exp(xi)
    # The plane in the moved camera's frame: n' = R^T n, offset' = offset - n . t.
    moved = plane_depth(CAMERA.rays(), T[:3, :3].T @ NORMAL, OFFSET - NORMAL @ T[:3, 3])
    exact = (moved - plane_depth(CAMERA.rays())) / STEP
    np.testing.assert_allclose(pose_columns(plane_frame())[..., axis], exact, atol=2e-3)


def test_beside_poses_nothing_is_left_of_what_a_pose_makes() -> None:
    """A plane determines three of the six directions of a pose."""
    poses = pose_columns(plane_frame()).reshape(-1, 6)
    other = np.sin(np.arange(len(poses)))
    left = beside_poses(np.column_stack([poses @ [1, -2, 3, 0.1, 0.2, -0.3], other]), poses)
    np.testing.assert_allclose(left[:, 0], 0.0, atol=1e-9)
    np.testing.assert_allclose(poses.T @ left[:, 1], 0.0, atol=1e-9 * np.abs(poses).sum())
    assert left[:, 1] @ left[:, 1] > 0.9 * other @ other


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("fx_rel", {"fx": CAMERA.fx * (1 + STEP)}),
        ("fy_rel", {"fy": CAMERA.fy * (1 + STEP)}),
        ("cx_px", {"cx": CAMERA.cx + STEP}),
        ("cy_px", {"cy": CAMERA.cy + STEP}),
        ("k1", {"distortion": (STEP,)}),
        ("k2", {"distortion": (0.0, STEP)}),
        ("p1", {"distortion": (0.0, 0.0, STEP)}),
        ("p2", {"distortion": (0.0, 0.0, 0.0, STEP)}),
    ],
)
def test_intrinsics_column_is_the_derivative_of_depth(name: str, change: dict[str, float]) -> None:
    values = {f: getattr(CAMERA, f) for f in ("width", "height", "fx", "fy", "cx", "cy")}
    true = Camera(**(values | change))
    exact = (plane_depth(true.rays()) - plane_depth(CAMERA.rays())) / STEP
    column = Intrinsics(z_from="true_lens").columns(plane_frame())[..., Intrinsics.LINEAR.index(name)]
    np.testing.assert_allclose(column, exact, atol=2e-3 * max(1.0, np.abs(exact).max()))
