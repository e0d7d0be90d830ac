# SPDX-License-Identifier: Apache-2.0
"""Pixels that no point of a registered depth image falls on are no loss of the camera."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tests.tof_core.test_registered_holes import grid
from tests.tof_gap.quiet_views import SHAPE, views
from tof_core.reasons import Reason
from tof_gap.limits.missing import MissingLimits
from tof_gap.seen.evidence.between_points import between_points, hides_loss
from tof_gap.seen.missing.effects import missing_effects
from tof_gap.seen.missing.lost import expected


def test_holes_of_registered_depth_have_a_reason_of_their_own_and_no_loss_is_judged_beside_them() -> None:
    lost = np.zeros(SHAPE, bool)
    lost[: grid().shape[0], : grid().shape[1]] = grid()[: SHAPE[0], : SHAPE[1]]
    evidence = views(np.random.default_rng(3))
    seen = [replace(v.view, depth=np.where(lost, np.float32(np.nan), v.view.depth)) for v in evidence]
    named = between_points(seen)
    holes = named[0].reason == Reason.BETWEEN_POINTS
    inner = np.s_[2:-2, 2:-2]
    assert np.mean(holes[inner][lost[inner]]) > 0.9
    assert not holes[~lost].any()
    seen_through = [replace(v, view=n) for v, n in zip(evidence, named, strict=True)]
    assert hides_loss(seen_through)
    assert not expected(seen_through[0], MissingLimits()).any(), "holes move from capture to capture, and hide what the camera loses"
    assert expected(evidence[0], MissingLimits()).any()
    assert missing_effects(seen_through, MissingLimits()) == []


def test_depth_without_a_grid_of_holes_stays_as_it_is() -> None:
    seen = [v.view for v in views(np.random.default_rng(3))]
    assert all(one is other for one, other in zip(between_points(seen), seen, strict=True))
