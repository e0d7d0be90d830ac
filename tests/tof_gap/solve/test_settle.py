# SPDX-License-Identifier: Apache-2.0
"""The last step of a solution uses all pixels: the same effects, smaller errors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.tof_gap.quiet_views import VIEWS, chain, views
from tof_align.folds import deal
from tof_core import se3
from tof_core.config import from_mapping
from tof_gap.config import GapConfig
from tof_gap.solve.choose.select import select
from tof_gap.solve.hypotheses.candidate import Candidate
from tof_gap.solve.hypotheses.columns import ColumnStore, build
from tof_gap.solve.settle import followed, settled
from tof_gap.solve.solution import Joint
from tof_sensor.effects.depth_scale import DepthScale
from tof_sensor.effects.wiggling import Wiggling
from tof_sensor.geometry import pose_columns

DRAWN = 400
TRUE = Wiggling(modulation_mhz=66.0, sine_m=0.006, cosine_m=0.003)
CONFIG = from_mapping(GapConfig, {"evidence.pixels": DRAWN})


@pytest.fixture(scope="module")
def drawn() -> Joint:
    """A wiggle in noise, selected from `DRAWN` pixels a view."""
    extra = np.stack([TRUE.bias(v.frame) * v.frame.length for v in views(np.random.default_rng(1))])
    rng = np.random.default_rng(2)
    seen = tuple(replace(v, pixels=np.sort(rng.choice(v.pixels, DRAWN, replace=False))) for v in views(np.random.default_rng(1), extra))
    tested = [Candidate("depth_scale", DepthScale()), Candidate("wiggling", replace(TRUE, sine_m=0.0, cosine_m=0.0))]
    design = build(ColumnStore(seen, deal([0] * VIEWS, 6)), tested, chain(), CONFIG.hand_sd)
    return Joint(chain(), seen, design, select(design, CONFIG.select), asked=frozenset(c.name for c in tested))


def test_all_pixels_halve_the_errors_and_keep_the_effects(drawn: Joint) -> None:
    after = settled(drawn, CONFIG)
    assert [c.name for c, _ in after.members()] == [c.name for c, _ in drawn.members()] == ["wiggling"]
    assert len(after.views[0].pixels) == int(after.views[0].smooth.sum()) > 10 * DRAWN
    before, fine = (j.selection.fit for j in (drawn, after))
    assert np.sqrt(np.diag(fine.theta_cov)).max() < 0.5 * np.sqrt(np.diag(before.theta_cov)).max()
    (_, values), *_ = after.members()
    assert values == pytest.approx([TRUE.sine_m, TRUE.cosine_m], abs=2e-4)


def test_effects_that_were_not_chosen_were_asked_all_the_same(drawn: Joint) -> None:
    """Of a moving session, a lateness of motion is set apart as `time_sync` unless that was left out."""
    after = settled(drawn, CONFIG)
    assert {c.name for c in after.design.candidates} == {"wiggling"}
    assert after.asked == {"depth_scale", "wiggling"}


def test_no_more_pixels_are_taken_than_allowed(drawn: Joint) -> None:
    few = settled(drawn, from_mapping(GapConfig, {"solve.joint.settle_pixels": 900}))
    assert {len(v.pixels) for v in few.views} == {900}


def test_one_more_step_brings_the_cameras_where_the_chosen_effects_leave_no_residual() -> None:
    """A base some millimetres off, beside a wiggle: with the wiggle as a member the cameras are found, without it they imitate it."""
    begun = chain()
    base = np.array([4e-3, -3e-3, 5e-3, 2e-3, -1e-3, 3e-3])
    steps = [begun.links(v)[0][:, :6] @ base for v in range(VIEWS)]
    quiet = views(np.random.default_rng(1))
    extra = np.stack([(TRUE.bias(v.frame) + pose_columns(v.frame) @ step) * v.frame.length for v, step in zip(quiet, steps, strict=True)])
    seen = views(np.random.default_rng(1), extra)

    def off_m(members: list[Candidate]) -> float:
        """RMS of the rendered depth at the cameras found, against that at the true ones: what slides along a plane does not count."""
        after = followed(members, seen, begun, CONFIG)
        left = [se3.log(se3.inverse(begun.pose(v)) @ after.pose(v)) - step for v, step in enumerate(steps)]
        return float(np.sqrt(np.mean([(pose_columns(q.frame) @ xi) ** 2 for q, xi in zip(quiet, left, strict=True)])))

    found = off_m([Candidate("wiggling", replace(TRUE, sine_m=0.0, cosine_m=0.0))])
    assert found < 2e-4
    assert off_m([]) > 3 * found
