# SPDX-License-Identifier: Apache-2.0
"""Errors of poses against the true ones."""

from __future__ import annotations

import numpy as np
import pytest

from tof_core import se3
from tof_eval.sessions import pose_errors


def test_a_view_that_has_no_pose_is_left_out() -> None:
    true = [np.eye(4)] * 3
    found = pose_errors("live", [se3.exp([0.002, 0, 0, 0, 0, 0]), np.full((4, 4), np.nan), se3.exp([0, 0, 0, 0, 0, 0.01])], true)
    assert found.millimetres.tolist() == pytest.approx([2.0, 0.0])
    assert found.degrees.tolist() == pytest.approx([0.0, np.degrees(0.01)])
    none = pose_errors("live", [np.full((4, 4), np.nan)], true[:1])
    assert none.millimetres.shape == none.degrees.shape == (0,)
