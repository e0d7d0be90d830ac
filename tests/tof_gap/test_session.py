# SPDX-License-Identifier: Apache-2.0
"""A session whose camera is partly known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.tof_gap.quiet_views import SHAPE, views
from tof_gap.session import _apart_mm


def test_the_removed_bias_is_the_rms_over_pixels_that_both_have() -> None:
    before = [v.view for v in views(np.random.default_rng(0))][:2]
    bias = np.where(np.arange(SHAPE[1]) % 2, 0.003, 0.004)
    after = [replace(v, depth=(v.depth - bias).astype(np.float32)) for v in before]
    assert _apart_mm(before, after) == pytest.approx(1e3 * np.sqrt((0.003**2 + 0.004**2) / 2), rel=1e-3)
    nothing = [replace(v, depth=np.full(SHAPE, np.nan, np.float32)) for v in before]
    assert _apart_mm(before, nothing) == 0.0
