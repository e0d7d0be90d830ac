# SPDX-License-Identifier: Apache-2.0
"""From a selection to named effects: how sure a name is, and what its map holds."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from tests.tof_gap.quiet_views import SHAPE, VIEWS, chain, views
from tof_gap.limits.solve import SelectLimits
from tof_gap.solve.causes import Posed, confidence, smooth_ones
from tof_gap.solved import Named
from tof_sensor.effects.fixed_pattern import FixedPattern, packed
from tof_sensor.effects.range_offset import RangeOffset

WORTH = 120.0
"""Held-out chi-square that the member wins over all views."""


def sure(won: np.ndarray, name: str = "wiggling") -> float:
    """Confidence of a member that wins so much in each view; the lens contradicts its calibration without a wrong lens."""
    chosen = SimpleNamespace(members=(7,), inflate=1.0, held_out=np.zeros(len(won)))
    judge = SimpleNamespace(score=lambda *_: SimpleNamespace(held_out=won), gain=lambda _: 30.0, config=SelectLimits(rounds=4000))
    judge.needed_by_calibration = lambda called, _: called == "intrinsics"
    design = SimpleNamespace(candidates={7: SimpleNamespace(name=name)})
    joint = SimpleNamespace(selection=SimpleNamespace(chosen=chosen), design=design)
    return confidence(cast("Any", joint), cast("Any", judge), 0, np.random.default_rng(0))


def test_what_every_view_shows_is_sure() -> None:
    assert sure(np.full(12, WORTH / 12)) == 1.0


def test_what_one_view_shows_is_as_sure_as_that_view_is_drawn() -> None:
    assert sure(np.eye(12)[0] * WORTH) == pytest.approx(1 - (11 / 12) ** 12, abs=0.02)


def test_what_does_not_reach_the_gain_is_not_sure() -> None:
    assert sure(np.full(12, 2.0)) == 0.0


def test_a_lens_that_contradicts_its_calibration_is_sure_though_freeing_it_wins_little() -> None:
    assert sure(np.full(12, 1.0), "intrinsics") == 1.0


def test_instances_of_one_name_add_up_in_metres_of_depth() -> None:
    seen = views(np.random.default_rng(1))
    two = Named("range_offset", (RangeOffset(offset_m=0.004), RangeOffset(offset_m=0.002)), ({}, {}), (), 1.0)
    maps = Posed(seen, chain(), cast("Any", None), 0.02).shares([two])
    assert list(maps) == ["range_offset"]
    assert len(maps["range_offset"]) == VIEWS
    np.testing.assert_allclose(maps["range_offset"][3] * seen[3].frame.length, 0.006)


def test_a_pattern_without_its_pixels_keeps_its_fields() -> None:
    image = np.random.default_rng(2).normal(0, 0.003, SHAPE)
    pattern = FixedPattern(values=(0.0,) * (SHAPE[0] + SHAPE[1]) + (0.001,) * 15, pixels=packed(image))
    causes = [Named("fixed_pattern", (pattern,), ({},), (), 1.0), Named("range_offset", (RangeOffset(),), ({},), (), 1.0)]
    smooth, other = smooth_ones(causes)
    (effect,) = smooth.effects
    assert isinstance(effect, FixedPattern)
    assert effect.pixels == ""
    assert effect.values == pattern.values
    assert other is causes[1]
