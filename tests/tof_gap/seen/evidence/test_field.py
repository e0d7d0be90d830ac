# SPDX-License-Identifier: Apache-2.0
"""A wide camera that lights a circle: what lies outside of it is no lost pixel."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tests.tof_gap.quiet_views import CAMERA, SHAPE, views
from tof_core.reasons import Reason
from tof_gap.limits.missing import MissingLimits
from tof_gap.seen.evidence.field import LEAST_VIEWS, outside_field, within_field
from tof_gap.seen.missing.lost import expected, losses_of
from tof_gap.tell.report.files import without_depth

if TYPE_CHECKING:
    from tof_core.arrays import Mask
    from tof_core.capture import View

ROW, COLUMN = np.mgrid[: SHAPE[0], : SHAPE[1]]
CIRCLE = np.hypot(COLUMN - CAMERA.cx, ROW - CAMERA.cy) < 45.0


def lit(circle: Mask = CIRCLE, hole: int | None = None) -> list[View]:
    """Views that return nothing outside of the circle; `hole`: number of the only view that returns a patch in the middle, if any."""
    out = []
    for k, v in enumerate(views(np.random.default_rng(3))):
        returned = circle.copy()
        if hole is not None:
            returned[40:46, 50:60] &= k == hole
        depth = np.where(returned, v.view.depth, np.float32(np.nan))
        out.append(replace(v.view, depth=depth, reason=np.where(returned, v.view.reason, np.uint8(Reason.NO_RETURN))))
    return out


def test_pixels_that_return_in_no_view_are_outside_of_the_field() -> None:
    outside = outside_field(lit())
    assert outside is not None
    np.testing.assert_array_equal(outside, ~CIRCLE)
    marked = within_field(lit())
    assert all((v.reason[~CIRCLE] == Reason.OUT_OF_FIELD).all() and (v.reason[CIRCLE] == Reason.VALID).all() for v in marked)


def test_a_patch_that_is_lost_within_the_field_stays_lost() -> None:
    marked = within_field(lit(hole=-1))
    assert all((v.reason[40:46, 50:60] == Reason.NO_RETURN).all() for v in marked)


def test_a_pixel_that_one_view_returns_is_within_the_field() -> None:
    strip = COLUMN < 20
    seen = lit(~strip)
    seen[0] = views(np.random.default_rng(3))[0].view
    assert outside_field(seen) is None


def test_few_views_and_small_corners_tell_no_field() -> None:
    assert outside_field(lit()[: LEAST_VIEWS - 1]) is None
    corner = (COLUMN < 5) & (ROW < 5)
    assert outside_field(lit(~corner)) is None


def test_what_is_outside_of_the_field_is_not_expected_to_return_and_not_lost() -> None:
    limits = MissingLimits()
    seen = [replace(v, view=of) for v, of in zip(views(np.random.default_rng(3)), within_field(lit()), strict=True)]
    assert not any(expected(v, limits)[~CIRCLE].any() for v in seen)
    assert losses_of(seen, limits).gone.max() == 0.0
    unmarked = [replace(v, view=of) for v, of in zip(views(np.random.default_rng(3)), lit(), strict=True)]
    assert losses_of(unmarked, limits).gone.mean() > 0.2


def test_the_share_of_missing_pixels_is_that_within_the_field() -> None:
    marked = [replace(v, view=of) for v, of in zip(views(np.random.default_rng(3)), within_field(lit(hole=-1)), strict=True)]
    patch = 6 * 10 / CIRCLE.sum()
    assert without_depth(SimpleNamespace(evidence=marked)) == pytest.approx(patch, rel=1e-6)  # type: ignore[arg-type]
