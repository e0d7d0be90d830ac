# SPDX-License-Identifier: Apache-2.0
"""Loss that follows noisy rows is a filter's; loss at random or of dark surfaces is alike in next rows."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tests.tof_gap.quiet_views import SHAPE, views
from tof_core.reasons import Reason
from tof_gap.limits.missing import MissingLimits
from tof_gap.seen.missing.by_line import lost_by_lines
from tof_gap.seen.noise.lines import LineNoise

if TYPE_CHECKING:
    from collections.abc import Callable

    from tof_core.arrays import Float, Mask
    from tof_gap.seen.evidence.view import ViewEvidence

LIMITS = MissingLimits()
ROWS, COLUMNS = LineNoise(1, 0.005, 20.0), LineNoise(0, 0.005, 20.0)


def session(lose: Callable[[Float, np.random.Generator], Mask]) -> list[ViewEvidence]:
    """Quiet views, of which `lose(amplitude, rng)` takes pixels (H, W)."""
    rng, out = np.random.default_rng(8), []
    for v in views(np.random.default_rng(5)):
        gone = lose(v.frame.amplitude, rng)
        depth, reason = np.where(gone, np.nan, v.view.depth), np.where(gone, Reason.NO_RETURN, Reason.VALID)
        seen = replace(v.view, depth=depth.astype(np.float32), reason=reason.astype(np.uint8), count=(~gone).astype(np.uint16))
        out.append(replace(v, view=seen, residual=np.where(gone, np.nan, v.residual), smooth=v.smooth & ~gone))
    return out


def noisy_rows(_: Float, rng: np.random.Generator) -> Mask:
    """In each capture, other rows in six stand out of their neighbours, and lose two pixels of three."""
    return np.asarray((rng.random((SHAPE[0], 1)) < 1 / 6) & (rng.random(SHAPE) < 2 / 3))


def test_loss_of_other_rows_in_each_view_follows_the_noise_of_rows() -> None:
    lossy = session(noisy_rows)
    assert np.mean([~v.view.valid for v in lossy]) == pytest.approx(1 / 9, rel=0.1)
    assert lost_by_lines(lossy, [ROWS], LIMITS)
    assert not lost_by_lines(lossy, [COLUMNS], LIMITS)
    assert not lost_by_lines(lossy, [], LIMITS), "without noise of lines, rows may be lost for another reason"


@pytest.mark.parametrize("share", [0.01, 0.1])
def test_loss_at_random_does_not_follow_lines(share: float) -> None:
    assert not lost_by_lines(session(lambda _, rng: rng.random(SHAPE) < share), [ROWS, COLUMNS], LIMITS)


def test_loss_of_weak_light_does_not_follow_lines() -> None:
    """The light of the views waves from column to column, a wave of 57 columns."""
    assert not lost_by_lines(session(lambda light, _: light < np.quantile(light, 0.1)), [ROWS, COLUMNS], LIMITS)
