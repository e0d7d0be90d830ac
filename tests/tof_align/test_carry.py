# SPDX-License-Identifier: Apache-2.0
"""Information that is carried on: other columns of the surface take nothing from what is known of the camera."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tof_align.carry import Carry
from tof_align.discrepancy import empty_basis
from tof_align.parts import PartFrames

SIZES = {"range": 2e-3, "object": 1e-3, "part 0": 3e-3, "part 2": 1e-3}
BEFORE = replace(
    empty_basis(),
    root_range=np.eye(3),
    root_object=np.eye(2),
    order=0,
    parts=PartFrames(np.array([0, 2]), np.zeros((2, 3)), np.ones(2)),
)
AFTER = replace(BEFORE, root_object=np.eye(4), centres=np.ones((4, 6)), parts=PartFrames(np.array([1]), np.zeros((1, 3)), np.ones(1)))


def test_what_is_known_of_the_camera_stays_when_the_surface_has_other_columns() -> None:
    """Mean and covariance of base, hand-eye and range are those of the whole, with the prior of what was integrated out."""
    rng = np.random.default_rng(3)
    size, kept = 12 + sum(BEFORE.shared), 12 + 3
    A = rng.normal(size=(60, size))
    H, b = A.T @ A, rng.normal(size=size)
    prior = np.zeros(size)
    prior[kept : kept + 2] = SIZES["object"] ** -2
    prior[kept + 2 : kept + 8], prior[kept + 8 :] = SIZES["part 0"] ** -2, SIZES["part 2"] ** -2
    whole = np.linalg.inv(H + np.diag(prior))
    after = Carry(H, b, np.eye(4), np.eye(4)).with_surface_of(AFTER, BEFORE, SIZES)
    assert after.H.shape == (12 + sum(AFTER.shared),) * 2
    np.testing.assert_allclose(np.linalg.inv(after.H[:kept, :kept]), whole[:kept, :kept], rtol=1e-6, atol=1e-12)
    np.testing.assert_allclose(np.linalg.solve(after.H[:kept, :kept], after.b[:kept]), (whole @ b)[:kept], rtol=1e-6, atol=1e-12)
    assert not after.H[kept:].any()
    assert not after.b[kept:].any()
