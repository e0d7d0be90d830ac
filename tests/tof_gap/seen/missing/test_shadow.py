# SPDX-License-Identifier: Apache-2.0
"""A lamp beside the lens leaves a shadow whose width follows from both depths."""

from __future__ import annotations

import numpy as np
import pytest

from tof_core.camera import Camera
from tof_gap.seen.missing.shadow import shadowed

CAMERA = Camera(width=200, height=80, fx=200.0, fy=200.0, cx=99.5, cy=39.5)
SHAPE = CAMERA.shape


def beside(near_m: float, far_m: float) -> np.ndarray:
    """A far wall, and a near plate before the last twenty columns."""
    depth = np.full(SHAPE, far_m)
    depth[:, 180:] = near_m
    return depth


@pytest.mark.parametrize(("near_m", "width_px"), [(0.25, 30), (0.1, 90), (0.5, 10)])
def test_the_shadow_is_as_wide_as_the_difference_of_inverse_depths(near_m: float, width_px: int) -> None:
    """200 px x 50 mm x (1 / near - 1 / 1 m), less a block of four pixels."""
    dark = shadowed(beside(near_m, 1.0), CAMERA, 0.05)
    assert not dark[:, 180:].any(), "the near plate is lit"
    assert width_px - 8 <= dark[40].sum() <= width_px
    assert dark[40, 179]


def test_a_lamp_nearer_to_the_lens_leaves_a_narrower_shadow() -> None:
    wide, narrow = (shadowed(beside(0.1, 1.0), CAMERA, lamp_m)[40].sum() for lamp_m in (0.05, 0.02))
    assert narrow == pytest.approx(0.4 * wide, abs=8)


def test_a_slope_casts_none() -> None:
    """A floor from 0.4 m to 2 m over the image."""
    depth = np.broadcast_to(1.0 / np.linspace(2.5, 0.5, SHAPE[1]), SHAPE)
    assert not shadowed(depth, CAMERA, 0.05).any()


def test_off_the_cad_nothing_is_near_and_nothing_is_dark() -> None:
    depth = beside(0.25, 1.0)
    depth[:, 180:] = np.nan
    assert not shadowed(depth, CAMERA, 0.05).any()
    assert not shadowed(np.full(SHAPE, np.nan), CAMERA, 0.05).any()
