# SPDX-License-Identifier: Apache-2.0
"""Amplitude bias: which sign points to the camera's window, and what a text recommends."""

from __future__ import annotations

import pytest

from tof_sensor.effects.amplitude_bias import AmplitudeBias

BRIGHT = "shorten the exposure first: bright surfaces are off"


@pytest.mark.parametrize(
    ("effect", "bright"),
    [
        pytest.param(
            AmplitudeBias(form="direct", direct_m=-0.002), True, id="pile-up: bright light is 6 mm nearer, weak light 2 mm farther"
        ),
        pytest.param(
            AmplitudeBias(form="direct", per_ln_m=0.004, per_ln2_m=0.001, direct_m=-0.005), True, id="walk near saturation: -7 and -1 mm"
        ),
        pytest.param(AmplitudeBias(per_ln_m=-0.005), False, id="a slow comparator: 8 mm in weak light, -7 mm in bright light"),
        pytest.param(
            AmplitudeBias(form="direct", per_ln_m=-0.011, per_ln2_m=-0.004, direct_m=0.0045),
            False,
            id="traps: the term that grows with the light straightens the curve, and bright surfaces are off the other way",
        ),
        pytest.param(AmplitudeBias(knots=(1.0, 2.0, 3.0), values=(0.001, 0.0, -0.004)), True, id="a curve that falls at its bright end"),
        pytest.param(AmplitudeBias(knots=(1.0, 2.0, 3.0), values=(-0.004, 0.0, -0.001)), False, id="a curve that rises from its weak end"),
    ],
)
def test_the_end_of_the_curve_that_is_off_is_named_first(effect: AmplitudeBias, *, bright: bool) -> None:
    assert effect.remedy.startswith(BRIGHT) == bright
    assert effect.remedy.endswith("trust bright parts less" if bright else "trust dark parts less")


@pytest.mark.parametrize(
    ("effect", "nearer"),
    [
        pytest.param(AmplitudeBias(per_ln_m=-0.005), False, id="a slow comparator: 8 mm farther at a fifth of the light"),
        pytest.param(AmplitudeBias(per_ln_m=0.005), True, id="the reverse"),
        pytest.param(AmplitudeBias(form="inverse", inverse_m=0.002), False, id="late charge: 8 mm farther"),
        pytest.param(AmplitudeBias(form="inverse", inverse_m=-0.005, per_ln_m=-0.001), True, id="light thrown back: 18 mm nearer"),
        pytest.param(AmplitudeBias(knots=(1.0, 2.0, 3.0), values=(0.004, 0.0, -0.001)), False, id="a curve that falls"),
        pytest.param(AmplitudeBias(knots=(1.0, 2.0, 3.0), values=(-0.004, 0.0, 0.001)), True, id="a curve that rises"),
    ],
)
def test_weak_light_that_is_measured_nearer_points_to_the_window(effect: AmplitudeBias, *, nearer: bool) -> None:
    assert effect.remedy.startswith("clean the camera's window") == nearer
    assert effect.remedy.endswith(AmplitudeBias.REMEDY)
