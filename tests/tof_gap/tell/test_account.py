# SPDX-License-Identifier: Apache-2.0
"""What a solution says: an effect without which held-out views come out better is not there."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from tof_gap.config import GapConfig
from tof_gap.limits.foreign import ForeignLightLimits
from tof_gap.limits.report import ReportLimits
from tof_gap.seen.finding import Finding
from tof_gap.solved import Named
from tof_gap.tell.account import Account, Cause, arms_beyond_prior, unfounded, without_causes
from tof_gap.tell.figures.shrink import Errors, Shrink
from tof_sensor.effects.dropout import Dropout
from tof_sensor.effects.interference import Interference
from tof_sensor.effects.noise import Noise
from tof_sensor.effects.phase_wrap import PhaseWrap

NOTHING = Errors(0.0, 0.0, 0.0)


def gap_of(shrink: float | None) -> Shrink:
    return Shrink(NOTHING, NOTHING, 0.0, shrink, None)


def account(shrink: float | None, **left_out: float | None) -> Account:
    """A solution that shrinks the held-out gap by `shrink`, and by so much without each cause."""
    gap = gap_of(shrink)
    causes = tuple(Cause(Named(name, (), (), (), 1.0), gap, without, 2e-3) for name, without in left_out.items())
    unused = cast("Any", None)
    figures = cast("Any", SimpleNamespace(limits=ReportLimits(), added2=defaultdict(float, SIZES2)))
    return Account(unused, causes, (), figures, gap)


SIZES2 = {"wiggling": 2.0, "amplitude_bias": 1.0, "phase_wrap": 900.0}
"""What effects add to depth, mean squares in mm^2."""


@pytest.mark.parametrize(
    ("shrink", "left_out", "worsens"),
    [
        (0.9, {"wiggling": 0.0}, None),
        (0.5, {"wiggling": 0.1, "subsurface": 0.53}, None),  # a tie between noise and noise
        (0.5, {"wiggling": 0.1, "subsurface": 0.6}, "subsurface"),
        (-2.9, {"motion": -3.8, "cad_deviation": 0.85, "specular": 0.1}, "cad_deviation"),
        (-0.2, {"specular": 0.0}, "specular"),
        (None, {"noise": None}, None),
    ],
)
def test_the_cause_that_makes_held_out_views_worst_is_found(
    shrink: float | None, left_out: dict[str, float | None], worsens: str | None
) -> None:
    assert account(shrink, **left_out).worsens == worsens


@pytest.mark.parametrize(("posed_m", "taken"), [(0.0, None), (0.02, "temperature_drift")])
def test_a_drift_that_foreign_light_would_show_by_chance_is_taken_out(posed_m: float, taken: str | None) -> None:
    drift = [np.full((2, 2), 0.004 * k / 12) for k in range(12)]
    found = replace(
        account(0.5, temperature_drift=0.1),
        solved=cast("Any", SimpleNamespace(maps={"temperature_drift": drift})),
        figures=cast("Any", SimpleNamespace(limits=ReportLimits(), posed_m=posed_m)),
    )
    assert unfounded(found, ForeignLightLimits()) == taken


def test_a_cause_that_too_few_views_show_is_no_name() -> None:
    found = account(0.9, amplitude_bias=0.1, wiggling=0.7)
    few = replace(found.causes[1], named=replace(found.causes[1].named, suspected=True))
    assert found.names(causes=True) == ("wiggling", "amplitude_bias")
    assert replace(found, causes=(found.causes[0], few)).names(causes=True) == ("amplitude_bias",)


def test_names_begin_with_what_changes_depth_most_and_end_with_what_changes_none() -> None:
    findings = (Finding(Dropout(), 1.0), Finding(Noise(extra_m=0.002), 0.95), Finding(PhaseWrap(), 1.0))
    found = replace(account(0.9, amplitude_bias=0.1, wiggling=0.7), findings=findings)
    assert found.names(causes=True) == ("phase_wrap", "wiggling", "amplitude_bias", "dropout", "noise")


def test_causes_that_are_only_suspected_shrink_nothing() -> None:
    """A wiggle of the solution and wrapped pixels: only the latter are asserted."""
    shrinks = {("phase_wrap",): 0.7, (): 0.0}
    counted = cast("Any", SimpleNamespace(maps={"wiggling": [], "phase_wrap": []}, shrink=lambda names: gap_of(shrinks[tuple(names)])))
    solved = cast("Any", SimpleNamespace(maps={"wiggling": []}))
    both = replace(account(0.9, wiggling=0.7), solved=solved, figures=counted, findings=(Finding(PhaseWrap(), 1.0),))
    assert without_causes(both).gap.shrink == 0.7
    alone = replace(both, figures=cast("Any", SimpleNamespace(**vars(counted) | {"maps": {"wiggling": []}})), findings=())
    assert without_causes(alone).gap.shrink == 0.0


def test_what_was_read_off_structure_is_no_name_beside_structure_without_one() -> None:
    stripes = Finding(Interference(burst_m=0.001), 0.95, structure=True)
    rows = Finding(Noise(extra_m=0.002), 0.95)
    found = replace(account(0.9, wiggling=0.7), findings=(stripes, rows))
    assert found.names(causes=True) == ("wiggling", "interference", "noise")
    assert found.names(causes=False) == ("noise",)


@pytest.mark.parametrize(
    ("times", "beyond"),
    [((0.9,) * 6, (False, False)), ((0.5, 0.5, 3.0, 0.5, 0.5, 0.5), (True, False)), ((3.0,) * 6, (False, True))],
    ids=["as expected", "along the optical axis", "in all axes"],
)
def test_arms_beyond_their_prior_are_no_sign_beside_another_camera_s_light(times: tuple[float, ...], beyond: tuple[bool, bool]) -> None:
    """Arm errors of so many standard deviations in each axis."""
    sd = np.full((20, 6), 2e-3)
    solved: Any = SimpleNamespace(arms=np.array(times) * sd * np.random.default_rng(7).standard_normal(sd.shape), arms_sd=sd)
    assert arms_beyond_prior(solved, (), GapConfig()) == beyond
    assert arms_beyond_prior(solved, (Finding(Interference(burst_m=0.004), 0.95),), GapConfig()) == (False, False)
