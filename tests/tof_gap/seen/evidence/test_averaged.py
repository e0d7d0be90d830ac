# SPDX-License-Identifier: Apache-2.0
"""What an average over neighbours in the camera makes of curved surfaces: half of the curvature times the mean square distance in the window."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tests.tof_gap.quiet_views import CAMERA, rendering
from tof_gap.seen.evidence.averaged import averaging_error

if TYPE_CHECKING:
    from tof_scene.rendering import Rendering

SHAPE = CAMERA.shape
FLAT = np.ones(SHAPE)
"""Range along the ray over z of a camera with parallel rays."""


def bowl(bend_m: float, *, part: np.ndarray | None = None) -> Rendering:
    """Depth 1 m + bend_m (u^2 + v^2) of a surface, u and v in pixels from the middle of the image, parallel rays."""
    row, column = np.mgrid[: SHAPE[0], : SHAPE[1]] - np.array(SHAPE)[:, None, None] / 2.0
    depth = np.asarray(1.0 + bend_m * (row**2 + column**2), np.float32)
    return replace(rendering(0.0), depth=depth, part=np.zeros(SHAPE, np.int16) if part is None else part)


@pytest.mark.parametrize(("window_px", "mean_square"), [(3, 4 / 3), (5, 4.0), (4, 3.0)])
def test_the_mean_of_a_window_lies_off_a_curved_surface(window_px: int, mean_square: float) -> None:
    """A window of m pixels has a mean square distance of (m^2 - 1) / 12 along each axis; one of 4, its rim counted half, of 1.5."""
    error, doubtful = averaging_error(bowl(1e-5), FLAT, window_px)
    assert not doubtful.any()
    inside = error[3:-3, 3:-3]
    np.testing.assert_allclose(inside, 1e-5 * mean_square, atol=2e-7)  # depth is in single precision: 6e-8 of a metre


def test_a_plane_however_tilted_is_measured_where_it_is() -> None:
    tilted = replace(bowl(0.0), depth=np.asarray(1.0 + 0.004 * np.mgrid[: SHAPE[0], : SHAPE[1]].sum(axis=0), np.float32))
    np.testing.assert_allclose(averaging_error(tilted, FLAT, 5)[0], 0.0, atol=2e-7)


def test_other_parts_and_steps_do_not_count() -> None:
    step = bowl(0.0)
    step.depth[:, SHAPE[1] // 2 :] += 0.05
    np.testing.assert_allclose(averaging_error(step, FLAT, 3)[0], 0.0, atol=2e-7)
    part = np.zeros(SHAPE, np.int16)
    part[:, SHAPE[1] // 2 :] = 1
    ledge = bowl(0.0, part=part)
    ledge.depth[:, SHAPE[1] // 2 :] += 0.005
    np.testing.assert_allclose(averaging_error(ledge, FLAT, 3)[0], 0.0, atol=2e-7)


def test_what_is_not_rendered_has_no_error() -> None:
    hole = bowl(1e-5)
    hole.depth[40:50, 40:50] = np.nan
    error, _ = averaging_error(hole, FLAT, 5)
    assert np.isfinite(error[30:40, 30:40]).all()
    assert not np.nan_to_num(error[40:50, 40:50]).any()


def test_beside_a_crease_or_a_small_step_it_is_not_known_what_the_filter_does() -> None:
    step = bowl(0.0)
    step.depth[:, 60:] += 0.01
    _, doubtful = averaging_error(step, FLAT, 5)
    np.testing.assert_array_equal(np.flatnonzero(doubtful[SHAPE[0] // 2]), [58, 59, 60, 61])
