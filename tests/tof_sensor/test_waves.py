# SPDX-License-Identifier: Apache-2.0
"""Sine and cosine of many phases."""

from __future__ import annotations

import numpy as np
import pytest

from tof_sensor.waves import sine_cosine


@pytest.mark.parametrize("turns", [0.0, 0.125, 0.5, -0.3, 1234.56])
def test_a_phase_of_many_turns_has_the_sine_and_cosine_of_its_fraction(turns: float) -> None:
    sine, cosine = sine_cosine(np.array([turns]))
    assert float(sine[0]) == pytest.approx(np.sin(2 * np.pi * turns), abs=3e-7)
    assert float(cosine[0]) == pytest.approx(np.cos(2 * np.pi * turns), abs=3e-7)


def test_an_unknown_phase_stays_unknown() -> None:
    assert np.isnan(sine_cosine(np.array([np.nan]))).all()
