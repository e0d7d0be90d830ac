# SPDX-License-Identifier: Apache-2.0
"""A constant apart from a bias by the amplitude: by how little such a bias has left in the light in which it is least."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tests.tof_gap.quiet_views import views
from tof_gap.solve.offset import offset_apart
from tof_gap.solved import Named
from tof_sensor.effects.amplitude_bias import AmplitudeBias
from tof_sensor.effects.motion import Motion
from tof_sensor.effects.range_offset import RangeOffset

if TYPE_CHECKING:
    from collections.abc import Callable

    from tof_gap.seen.evidence.view import ViewEvidence

LEAST_M = 1e-3
DIM, BRIGHT = 100.0, 1600.0
LATE_M = 0.0075
"""Bias of late charge at the amplitude `DIM`: at 16 times the light it is 1/16."""
MOTION = Named("motion", (Motion(edge=0.6),), ({"edge": 0.01},), (), 1.0)


@pytest.fixture(scope="module")
def seen() -> tuple[ViewEvidence, ...]:
    """Views whose amplitudes rise evenly in the logarithm from `DIM` to `BRIGHT`."""
    evidence = views(np.random.default_rng(0))[:2]
    light = np.geomspace(DIM, BRIGHT, evidence[0].frame.amplitude.size).reshape(evidence[0].frame.amplitude.shape)
    return tuple(replace(v, frame=replace(v.frame, amplitude=light)) for v in evidence)


def late_charge(constant_m: float) -> Named:
    """Late charge, whose error is inverse to the light, and a constant."""
    effect = AmplitudeBias(constant_m, form="inverse", inverse_m=LATE_M, reference=DIM)
    return Named("amplitude_bias", (effect,), ({"at_reference_m": 1e-4, "inverse_m": 1e-4},), ("range_offset", "subsurface"), 0.9)


def by_curve(constant_m: float) -> Named:
    """The same as a curve."""
    knots = np.log(np.geomspace(DIM, BRIGHT, 30))
    values = constant_m + LATE_M * DIM / np.exp(knots)
    effect = AmplitudeBias(knots=tuple(knots), values=tuple(values))
    return Named("amplitude_bias", (effect,), ({f"at_{k}": 2e-4 for k in range(30)},), (), 0.9)


def offset_m(one: Named) -> float:
    """Of a named `range_offset`."""
    (effect,) = one.effects
    assert isinstance(effect, RangeOffset)
    return effect.offset_m


@pytest.mark.parametrize("made", [late_charge, by_curve])
@pytest.mark.parametrize("constant_m", [0.004, 0.0])
def test_a_constant_is_named_besides_where_a_bias_by_the_light_alone_would_be_less(
    made: Callable[[float], Named], constant_m: float, seen: tuple[ViewEvidence, ...]
) -> None:
    """At 16 times the light, 0.5 mm of late charge is left, and 2.3 mm by the flattest law: 4.5 mm are more, 0.5 mm are not."""
    one = made(constant_m)
    found = offset_apart((one, MOTION), seen, LEAST_M)
    if not constant_m:
        assert found == (one, MOTION)
        return
    assert [n.name for n in found] == ["amplitude_bias", "motion", "range_offset"]
    bias, _, constant = found
    assert offset_m(constant) == pytest.approx(constant_m, abs=1e-4), "late charge keeps its own share"
    together = bias.effects[0].bias(seen[0].frame) + constant.effects[0].bias(seen[0].frame)
    np.testing.assert_allclose(
        together, one.effects[0].bias(seen[0].frame), atol=1e-12, err_msg="the sum of both is the bias that was found"
    )


def test_the_constant_is_negative_where_all_is_measured_nearer(seen: tuple[ViewEvidence, ...]) -> None:
    found = offset_apart(
        (replace(late_charge(0.0), effects=(AmplitudeBias(-0.005, form="inverse", inverse_m=-LATE_M, reference=DIM),)),), seen, LEAST_M
    )
    assert offset_m(found[1]) == pytest.approx(-0.005, abs=1e-4)


def test_a_bias_that_changes_sign_has_no_constant(seen: tuple[ViewEvidence, ...]) -> None:
    """A camera is calibrated at one amplitude, and its bias is 0 there."""
    one = late_charge(-0.004)
    assert offset_apart((one,), seen, LEAST_M) == (one,)


def test_named_beside_each_other_they_are_no_tie(seen: tuple[ViewEvidence, ...]) -> None:
    bias, constant = offset_apart((late_charge(0.004),), seen, LEAST_M)
    assert bias.ties == constant.ties == ("subsurface",)
    assert constant.confidence == 0.9


def test_the_constant_is_as_uncertain_as_the_law_of_the_light(seen: tuple[ViewEvidence, ...]) -> None:
    """7 mm change over light of 1 to 16, less a little at the ends: 2.3 mm by the flattest law, 0.5 mm by the usual one."""
    _, constant = offset_apart((late_charge(0.004),), seen, LEAST_M)
    assert constant.std[0]["offset_m"] == pytest.approx(0.0009, abs=1e-4)


def test_a_constant_that_is_named_or_left_out_is_not_set_apart(seen: tuple[ViewEvidence, ...]) -> None:
    named = Named("range_offset", (RangeOffset(0.002),), ({"offset_m": 1e-4},), (), 1.0)
    bias = late_charge(0.004)
    assert offset_apart((bias, named), seen, LEAST_M) == (bias, named)
    assert offset_apart((bias,), seen, LEAST_M, asked=False) == (bias,)


def test_a_session_without_a_bias_by_the_amplitude_is_left_as_it_is(seen: tuple[ViewEvidence, ...]) -> None:
    assert offset_apart((MOTION,), seen, LEAST_M) == (MOTION,)


def test_each_part_of_the_views_is_divided_alike(seen: tuple[ViewEvidence, ...]) -> None:
    """Without a least size, the constant is set apart however small it is: sizes are confirmed on other views than those that named it."""
    _, constant = offset_apart((late_charge(0.0005),), seen, -np.inf)
    assert offset_m(constant) == pytest.approx(0.0005, abs=1e-4)
