# SPDX-License-Identifier: Apache-2.0
"""Amplitude bias: which sign points to the camera's window, and what a text recommends."""

from __future__ import annotations

import pytest

from tof_sensor.effects.amplitude_bias import AmplitudeBias


@pytest.mark.parametrize(
    ("effect", "nearer"),
    [
        pytest.param(AmplitudeBias(per_ln_m=-0.005), False, id="a slow comparator: 8 mm farther at a fifth of the light"),
        pytest.param(AmplitudeBias(per_ln_m=0.005), True, id="the reverse"),
        pytest.param(AmplitudeBias(form="inverse", inverse_m=0.002), False, id="late charge: 8 mm farther"),
        pytest.param(AmplitudeBias(form="inverse", inverse_m=-0.005, per_ln_m=-0.001), True, id="light thrown back: 18 mm nearer"),
        pytest.param(AmplitudeBias(form="direct", direct_m=-0.002), False, id="pile-up: bright light is nearer"),
        pytest.param(AmplitudeBias(knots=(1.0, 2.0, 3.0), values=(0.004, 0.0, -0.001)), False, id="a curve that falls"),
        pytest.param(AmplitudeBias(knots=(1.0, 2.0, 3.0), values=(-0.004, 0.0, 0.001)), True, id="a curve that rises"),
    ],
)
def test_weak_light_that_is_measured_nearer_points_to_the_window(effect: AmplitudeBias, *, nearer: bool) -> None:
    assert effect.weak_is_nearer == nearer
    assert effect.remedy.startswith("clean the camera's window") == nearer
    assert effect.remedy.endswith(AmplitudeBias.REMEDY)
