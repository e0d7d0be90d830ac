# SPDX-License-Identifier: Apache-2.0
"""Lost pixels of two sessions: what both sensor models predict, and which share of their difference each session's own pixels show."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tests.tof_gap.quiet_views import SHAPE, views
from tof_gap.compare.loss import Lossy, loss_apart
from tof_gap.limits.missing import MissingLimits
from tof_sensor.effects.dropout import Dropout
from tof_sensor.model import SensorModel

if TYPE_CHECKING:
    from tof_gap.compare.loss import LossApart
    from tof_gap.seen.evidence.view import ViewEvidence

LEAST = 0.01
NEAR = 0.01
"""Saturated pixels do not count as lost: the brightest 0.3 % of these views."""


@pytest.fixture(scope="module")
def evidence() -> tuple[ViewEvidence, ...]:
    """Views of a plane with photon noise."""
    return views(np.random.default_rng(3))


def session(evidence: tuple[ViewEvidence, ...], share: float, *effects: Dropout) -> Lossy:
    """Dwells of a hundred captures that lose this share of all returns, and the effects that a diagnosis names."""
    count = np.full(SHAPE, round(100 * (1 - share)), np.uint16)
    lossy = [replace(v, view=replace(v.view, captures=100, count=count)) for v in evidence]
    return Lossy(lossy, SensorModel(effects), 1.0)


def apart(real: Lossy, simulated: Lossy) -> LossApart | None:
    return loss_apart(real, simulated, ["panel"], MissingLimits(), LEAST)


def test_both_sessions_show_a_loss_that_one_has(evidence: tuple[ViewEvidence, ...]) -> None:
    found = apart(session(evidence, 0.05, Dropout(random=0.05)), session(evidence, 0.0))
    assert found is not None
    assert (found.level.real, found.level.simulated) == pytest.approx((0.05, 0.0))
    assert found.level.parts == {"panel": pytest.approx(0.05)}
    assert found.level.has == (True, False)
    assert found.shown == pytest.approx((1.0, 1.0), abs=NEAR)


def test_a_session_that_loses_as_much_unnamed_shows_no_difference(evidence: tuple[ViewEvidence, ...]) -> None:
    """Loss below a threshold: darker views lose enough to be named, brighter ones of the same camera do not."""
    named, unnamed = session(evidence, 0.04, Dropout(random=0.04)), session(evidence, 0.03)
    found, mirrored = apart(named, unnamed), apart(unnamed, named)
    assert found is not None
    assert mirrored is not None
    assert found.shown == pytest.approx((1.0, 0.25), abs=NEAR)
    assert mirrored.shown == pytest.approx((0.25, 1.0), abs=NEAR)


def test_a_difference_below_the_least_is_none(evidence: tuple[ViewEvidence, ...]) -> None:
    assert apart(session(evidence, 0.0), session(evidence, 0.0)) is None
    assert apart(session(evidence, 0.05, Dropout(random=0.05)), session(evidence, 0.042, Dropout(random=0.042))) is None
