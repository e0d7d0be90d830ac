# SPDX-License-Identifier: Apache-2.0
"""What a stated calibration covers is no effect; what is smaller than the tolerance is none either."""

import numpy as np
import pytest

from tof_core.calibration import Calibration, HandEyeLimits, LensLimits
from tof_core.camera import Camera
from tof_gap.solve.tolerance import calibrated, size_m
from tof_gap.solved import Named
from tof_sensor.effect import Effect
from tof_sensor.effects.hand_eye import HandEye
from tof_sensor.effects.intrinsics import Intrinsics
from tof_sensor.effects.wiggling import Wiggling

CAMERA = Camera(width=128, height=98, fx=120.0, fy=120.0, cx=63.5, cy=48.5)
STATED = Calibration(HandEyeLimits(2.0, 0.2), LensLimits(0.3, 0.1))


def named(effect: Effect, sd: float = 1e-5) -> Named:
    return Named(effect.NAME, (effect,), (dict.fromkeys(effect.coefficient_names, sd),), (), 1.0)


@pytest.mark.parametrize(
    ("effect", "covered"),
    [
        (HandEye(x_m=0.0019), True),
        (HandEye(x_m=0.0015, y_m=0.0015), False),  # 2.1 mm
        (HandEye(x_m=0.001, rz_rad=float(np.radians(0.25))), False),
        (Intrinsics(cx_px=0.2, cy_px=0.2), True),
        (Intrinsics(cx_px=0.5), False),
        (Intrinsics(k1=0.05), False),  # 1.2 px RMS
        (Wiggling(sine_m=1e-5), False),  # no calibration states it
    ],
)
def test_hand_eye_and_lens_are_covered_up_to_the_stated_error(effect: Effect, *, covered: bool) -> None:
    assert calibrated(named(effect), STATED, CAMERA) is covered


def test_an_estimate_beyond_the_stated_error_is_covered_within_its_deviation() -> None:
    beyond = HandEye(x_m=0.0022)
    assert not calibrated(named(beyond, 1e-5), STATED, CAMERA)
    assert calibrated(named(beyond, 3e-4), STATED, CAMERA)


def test_nothing_is_covered_where_nothing_is_stated() -> None:
    assert not calibrated(named(HandEye(x_m=1e-6)), Calibration(), CAMERA)
    assert not calibrated(named(Intrinsics(cx_px=1e-3)), Calibration(), CAMERA)


def test_a_map_is_measured_over_the_pixels_that_it_affects() -> None:
    corner = np.zeros((1000, 1))
    corner[:30] = 1.0
    exact = np.zeros((1, 1))
    assert size_m(corner, np.array([2e-3]), exact) == pytest.approx(2e-3)
    assert size_m(np.ones((1000, 1)), np.array([2e-3]), exact) == pytest.approx(2e-3)
    assert size_m(np.zeros((1000, 1)), np.array([2e-3]), exact) == 0.0


def test_what_noise_gives_a_map_is_no_size() -> None:
    rng = np.random.default_rng(0)
    columns, cov = rng.normal(size=(1000, 2)), np.diag([4e-6, 1e-6])
    by_chance = [size_m(columns, rng.multivariate_normal(np.zeros(2), cov), cov) ** 2 for _ in range(500)]
    assert np.sqrt(np.mean(by_chance)) < np.sqrt(np.trace(cov))
    values = np.array([5e-3, 0.0])
    assert size_m(columns, values, cov) ** 2 < size_m(columns, values, 0 * cov) ** 2
