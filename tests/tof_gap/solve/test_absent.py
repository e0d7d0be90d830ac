# SPDX-License-Identifier: Apache-2.0
"""How large an effect may be that a session does not show: on columns that are drawn, so that its true size is known."""

from __future__ import annotations

from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from tests.tof_gap.solve.choose.test_select import PIXELS, VIEWS, design, plain
from tof_gap.config import GapConfig
from tof_gap.limits.solve import SelectLimits
from tof_gap.solve.absent import SURE, bounds
from tof_gap.solve.choose.judge import Selector
from tof_gap.solve.choose.worth import rescored
from tof_sensor.effects.depth_scale import DepthScale
from tof_sensor.effects.range_offset import RangeOffset
from tof_sensor.effects.subsurface import Subsurface
from tof_sensor.effects.temperature_drift import TemperatureDrift

if TYPE_CHECKING:
    from tof_gap.solve.hypotheses.columns import Design

CONFIG = GapConfig()
DEVIATION = 1.0 / np.sqrt(VIEWS * PIXELS)
"""Of a coefficient, for columns of unit size and noise of 1."""


def below(d: Design, chosen: tuple[int, ...], views: tuple[Any, ...] = ()) -> dict[str, float]:
    """The bounds beside the chosen candidates, in units of the noise of a pixel."""
    judge = Selector(d, SelectLimits())
    joint: Any = SimpleNamespace(design=d, selection=SimpleNamespace(chosen=rescored(judge, chosen)), views=views)
    return {name: bound.below_m / d.system.sigma for name, bound in bounds(joint, CONFIG).items()}


def test_an_effect_that_is_not_there_is_bounded_by_its_noise() -> None:
    found = below(design(plain(RangeOffset(), DepthScale()), [0.3, 0.0]), (0,))
    assert found.keys() == {"depth_scale"}
    assert SURE * DEVIATION < found["depth_scale"] < (SURE + 3.0) * DEVIATION


@pytest.mark.parametrize("seed", range(5))
def test_an_effect_that_is_there_and_not_chosen_is_smaller_than_its_bound(seed: int) -> None:
    found = below(design(plain(RangeOffset(), TemperatureDrift()), [0.3, 0.1], seed=seed), (0,))
    assert 0.1 < found["temperature_drift"] < 0.1 + 5.0 * DEVIATION


def test_what_a_chosen_effect_can_make_as_well_has_a_wide_bound() -> None:
    alike = below(design(plain(RangeOffset(), DepthScale()), [0.3, 0.0], copies=(0, 1)), (0,))
    apart = below(design(plain(RangeOffset(), DepthScale()), [0.3, 0.0]), (0,))
    assert alike["depth_scale"] > 3.0 * apart["depth_scale"]


def test_an_effect_of_one_part_is_stated_over_the_pixels_of_that_part() -> None:
    part = np.repeat([0, 1, 1, 1], 100)
    views = tuple(SimpleNamespace(pixels=np.arange(400), rendering=SimpleNamespace(part=part)) for _ in range(VIEWS))
    on_first = below(design(plain(RangeOffset(), Subsurface(part=0)), [0.3, 0.0]), (0,), views)["subsurface"]
    on_other = below(design(plain(RangeOffset(), Subsurface(part=1)), [0.3, 0.0]), (0,), views)["subsurface"]
    assert on_first == pytest.approx(np.sqrt(3.0) * on_other)
