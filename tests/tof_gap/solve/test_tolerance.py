# SPDX-License-Identifier: Apache-2.0
"""What a stated calibration covers is no effect; what is smaller than the tolerance is none either."""

from dataclasses import replace

import numpy as np
import pytest

from tests.tof_gap.quiet_views import SHAPE, views
from tof_core.calibration import Calibration, HandEyeLimits, LensLimits
from tof_core.camera import Camera
from tof_gap.solve.confirmed import confirmed, energy_share, mean_square, sizes_m
from tof_gap.solve.tolerance import calibrated
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


def test_a_right_map_is_confirmed_over_the_pixels_that_it_affects() -> None:
    rng = np.random.default_rng(0)
    noise, corner = rng.normal(0, 3e-3, 20_000), np.zeros(20_000)
    corner[:4000] = 2e-3
    assert confirmed(corner, noise) == pytest.approx(1.0, abs=0.1)
    assert confirmed(np.full(20_000, 2e-3), noise) == pytest.approx(1.0, abs=0.1)
    assert confirmed(np.zeros(20_000), noise) == 0.0
    assert mean_square(corner) == pytest.approx(2e-3**2)


def test_a_map_of_what_is_not_there_is_not_confirmed() -> None:
    rng = np.random.default_rng(0)
    false = np.full(20_000, 2e-3)
    assert confirmed(false, rng.normal(0, 3e-3, 20_000) - false) == 0.0


def test_a_map_twice_too_large_is_confirmed_by_nothing_and_one_of_half_the_size_by_more_than_its_own() -> None:
    true, noise = np.full(20_000, 2e-3), np.random.default_rng(0).normal(0, 1e-3, 20_000)
    assert confirmed(2 * true, noise - true) == pytest.approx(0.0, abs=0.03)
    assert confirmed(true / 2, noise + true / 2) == pytest.approx(3.0, rel=0.1)


def test_what_smears_is_as_large_as_its_map_at_edges_and_other_effects_as_where_they_were_fitted() -> None:
    flat, edge = np.s_[:, :100], np.s_[:, 100:]
    seen = views(np.random.default_rng(0))
    off = np.zeros(SHAPE)
    off[flat], off[edge] = 4e-3, 8e-3
    within = np.zeros(SHAPE, bool)
    within[flat] = True
    fitted = [replace(v, residual=v.residual + off, smooth=v.smooth & within) for v in seen]
    maps = [off] * len(seen)
    everywhere = np.sqrt(np.mean(off**2))
    assert sizes_m({"motion": maps}, fitted, [0, 1, 2])["motion"] == pytest.approx(everywhere, rel=0.05)
    assert sizes_m({"wiggling": maps}, fitted, [0, 1, 2])["wiggling"] == pytest.approx(4e-3, rel=0.05)


def test_a_size_is_that_over_all_views_though_the_held_out_ones_see_less_of_it() -> None:
    """Gloss of one part: 1 mm in the held-out view, 4 mm in the others; a map twice too large is confirmed by nothing in either."""
    seen = views(np.random.default_rng(0))
    sizes = np.array([1e-3, *[4e-3] * (len(seen) - 1)])
    off = [np.full(SHAPE, size) for size in sizes]
    fitted = [replace(v, residual=v.residual + o) for v, o in zip(seen, off, strict=True)]
    over_all = np.sqrt(np.mean(sizes**2))
    assert sizes_m({"specular": off}, fitted, [0])["specular"] == pytest.approx(over_all, rel=0.1)
    assert sizes_m({"specular": [2 * o for o in off]}, fitted, [0])["specular"] < 0.5 * over_all


def test_a_map_has_the_share_of_the_energy_that_it_has_over_all_pixels() -> None:
    """8 mm on one pixel in a hundred, where nothing else is, beside 4 mm on the others: 64 of 64 + 99 * 16."""
    late, taps = np.full((10, 10), 4e-3), np.full((10, 10), np.nan)
    late[0, 0], taps[0, 0] = 0.0, 8e-3
    assert energy_share("motion", {"time_sync": [late, late], "motion": [taps, taps]}) == pytest.approx(64 / (64 + 99 * 16))
