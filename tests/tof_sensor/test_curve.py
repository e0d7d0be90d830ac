# SPDX-License-Identifier: Apache-2.0
"""An effect's free form: any function of the observable on which the effect depends."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tests.tof_sensor.plane import plane_frame
from tof_sensor.curve import CurveEffect, Knots
from tof_sensor.effects.amplitude_bias import AmplitudeBias
from tof_sensor.effects.temperature_drift import TemperatureDrift
from tof_sensor.effects.wiggling import Wiggling
from tof_sensor.frame import Context
from tof_sensor.model import SensorModel, load_model, save_model

if TYPE_CHECKING:
    from pathlib import Path

FRAME = plane_frame(Context(time_s=150.0))
LENGTH = FRAME.length


def test_a_bias_of_light_is_interpolated_between_its_knots_along_the_ray() -> None:
    log = np.log(FRAME.amplitude)
    knots = tuple(np.quantile(log, [0.1, 0.5, 0.9]).tolist())
    curve = AmplitudeBias.curve(Knots(knots, (0.3, 0.3, 0.3))).with_coefficients(np.array([0.004, 0.001, -0.002]))
    np.testing.assert_allclose(curve.bias(FRAME) * LENGTH, np.interp(log, knots, [0.004, 0.001, -0.002]), atol=1e-12)
    assert curve.coefficients.tolist() == [0.004, 0.001, -0.002]


def test_pixels_without_light_or_surface_have_none() -> None:
    dark = FRAME.amplitude.copy()
    dark[3, 4] = 0.0
    bias = AmplitudeBias(knots=(-2.0, 0.0, 1.0), values=(0.01, 0.01, 0.01)).bias(replace(FRAME, amplitude=dark))
    assert bias[3, 4] == 0.0
    assert bias[3, 5] == pytest.approx(0.01 / LENGTH[3, 5])


def test_a_drift_is_one_constant_along_every_ray_of_a_view() -> None:
    drift = TemperatureDrift(knots=(0.0, 100.0, 200.0), values=(0.0, 0.004, 0.010))
    np.testing.assert_allclose(drift.bias(FRAME) * LENGTH, 0.007)
    assert drift.stated == "10.0 mm between the extremes, in no regular course"


def test_a_curve_of_range_has_no_mean_over_the_session_as_that_is_an_offset() -> None:
    knots = (0.8, 0.9, 1.0)
    wave = Wiggling.curve(Knots(knots, (0.2, 0.5, 0.3))).with_coefficients(np.array([0.002, -0.001, 0.003]))
    mean = 0.2 * 0.002 - 0.5 * 0.001 + 0.3 * 0.003
    np.testing.assert_allclose(wave.bias(FRAME) * LENGTH, np.interp(FRAME.radial, knots, [0.002, -0.001, 0.003]) - mean, atol=1e-12)
    assert wave.stated == "4.0 mm between the extremes, over ranges of 0.80 to 1.00 m, in no regular wave"


def test_a_curve_is_free_and_without_bounds_and_a_formula_is_not() -> None:
    curve = AmplitudeBias.curve(Knots((0.0, 1.0, 2.0), (0.0, 0.0, 0.0)))
    assert curve.free_form
    assert curve.coefficient_names == ("at_0", "at_1", "at_2")
    assert np.isinf(curve.bounds).all()
    formula = AmplitudeBias(per_ln_m=0.01)
    assert not formula.free_form
    assert formula.coefficient_names == AmplitudeBias.LINEAR
    assert formula.bounds[1].tolist() == [0.2, 0.05, 0.05, 0.05, 0.1, 0.1]
    assert formula.with_coefficients(np.arange(6.0)).coefficients.tolist() == [0, 1, 2, 3, 4, 5]


@pytest.mark.parametrize(
    ("effect", "rest"),
    [
        (AmplitudeBias(), "range_offset"),
        (AmplitudeBias(knots=(0.0, 1.0, 2.0), values=(0.0, 0.0, 0.0)), "range_offset"),
        (TemperatureDrift(), ""),
        (TemperatureDrift(knots=(0.0, 1.0, 2.0), values=(0.0, 0.0, 0.0)), "range_offset"),
        (TemperatureDrift(gain=True), "depth_scale"),
        (Wiggling(), ""),
        (Wiggling(knots=(0.0, 1.0, 2.0), values=(0.0, 0.0, 0.0), means=(0.3, 0.4, 0.3)), ""),
    ],
)
def test_without_its_own_terms_a_form_is_an_offset_or_a_scale(effect: CurveEffect, rest: str) -> None:
    assert effect.rest == rest


def test_curves_are_kept_in_a_sensor_model(tmp_path: Path) -> None:
    model = SensorModel(
        (
            Wiggling(knots=(0.5, 1.0, 1.5), values=(0.001, -0.002, 0.0), means=(0.3, 0.4, 0.3)),
            AmplitudeBias(knots=(-1.0, 0.0, 2.0), values=(0.003, 0.0, -0.001)),
            TemperatureDrift(drift_share=0.001, warmup_share=-0.002, tau_s=60.0, gain=True),
        )
    )
    save_model(model, tmp_path / "sensor.yaml")
    assert load_model(tmp_path / "sensor.yaml").effects == model.effects


def test_a_clock_that_drifts_errs_in_proportion_to_range() -> None:
    warm = plane_frame(Context(temperature=30.0, time_s=60.0))
    drift = TemperatureDrift(reference_share=0.001, drift_share=2e-4, warmup_share=0.01, reference_c=25.0, tau_s=60.0, gain=True)
    np.testing.assert_allclose(drift.bias(warm), warm.depth * (0.001 + 5 * 2e-4 + 0.01 * np.exp(-1)))
    assert (
        drift.stated
        == "+0.02 % of the range a kelvin of the thermometer and +1.00 % of the range at the start, fading with a time constant of 1.0 min"
    )


def test_a_walk_error_may_grow_with_range() -> None:
    sloped = AmplitudeBias(slope_m=0.004, form="slope", reference=2.0)
    np.testing.assert_allclose(sloped.bias(FRAME) * LENGTH, 0.004 * FRAME.radial * np.log(FRAME.amplitude / 2.0))
    assert AmplitudeBias(slope_m=0.004).bias(FRAME).any() == np.False_  # no term of another form


def test_of_a_view_without_pixels_there_are_columns_without_rows() -> None:
    """A view that contradicts the robot is emptied, and stays in the session."""
    empty = FRAME.take(np.zeros(0, np.int64))
    assert Wiggling.curve(Knots((0.8, 0.9, 1.0), (0.2, 0.5, 0.3))).columns(empty).shape == (1, 0, 3)
    assert TemperatureDrift(knots=(0.0, 100.0), values=(0.0, 0.0)).columns(empty).shape == (1, 0, 2)
