# SPDX-License-Identifier: Apache-2.0
"""The field of view that the doctor states is that of the lens, not of the camera matrix alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tof_core.camera import Camera
from toftwin.doctor.camera import described, field_deg, plausible

PINHOLE = Camera(width=200, height=100, fx=100.0, fy=100.0, cx=99.5, cy=49.5)


def test_the_field_of_a_pinhole_follows_from_its_focal_length() -> None:
    assert field_deg(PINHOLE) == pytest.approx((90.0, 53.13), abs=0.01)
    assert described(PINHOLE) == "200x100, fx 100.0, 90.0 x 53.1 degrees"


def test_barrel_distortion_widens_the_field() -> None:
    barrel = replace(PINHOLE, distortion_model="plumb_bob", distortion=(-0.12, 0.0, 0.0, 0.0, 0.0))
    width, height = field_deg(barrel)
    half = np.tan(np.radians([width / 2, height / 2]))
    at_border = barrel.project(np.array([[half[0], 0.0, 1.0], [0.0, half[1], 1.0]]))
    np.testing.assert_allclose([at_border[0, 0], at_border[1, 1]], [199.5, 99.5], atol=1e-3)
    assert width > 98


def test_a_field_beyond_the_lens_is_that_of_the_matrix_and_the_matrix_is_judged_alone() -> None:
    folded = replace(PINHOLE, distortion_model="plumb_bob", distortion=(-0.5, 0.0, 0.0, 0.0, 0.0))
    assert np.isfinite(field_deg(folded)).all()
    assert [f for f in plausible(folded) if "field of view" in f.what] == []
    wide = replace(PINHOLE, fx=50.0, fy=50.0)
    assert any("field of view 127 x 90 degrees" in f.what for f in plausible(wide))
