# SPDX-License-Identifier: Apache-2.0
"""The covariance of a first proposal holds the error that the camera's bias makes: a surface seen from elsewhere is measured with another bias."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
import pytest
from scipy.stats import chi2

from arm_correction.bias import _size, sights
from arm_correction.match import make_matcher, reference_surface
from arm_correction.reference import capture_reference
from arm_correction.register import register
from tests.arm_correction.made import CAMERA, CONFIG, FIRST, seen, twist
from tests.tof_align.made import foreign, section
from tof_core import se3

if TYPE_CHECKING:
    from tof_core.arrays import Float
    from tof_core.capture import View
    from tof_scene.raycast import Raycaster

USUAL_MM, PERIODS_M = 2.0, (0.25, 0.5)
"""Amplitude of usual wiggling, and its shortest and longest period."""
COUNT = 5
"""Proposals of each reach in each of two scenes."""


def measured(caster: Raycaster, T: Float, wave_mm: float, period_m: float, seed: int, believed: Float | None = None) -> View:
    """The view of a camera that wiggles over range."""
    view = seen(caster, T, seed=seed, believed=believed)
    length = CAMERA.ray_length()
    bias = 1e-3 * wave_mm * np.sin(2 * np.pi * view.depth * length / period_m) / length
    return replace(view, depth=(view.depth + bias).astype(np.float32))


@lru_cache(maxsize=2)
def squares(wave_mm: float) -> tuple[Float, Float]:
    """Of first proposals from up to 28 mm and from up to 120 mm: error^2 over stated covariance, of six; and the error in millimetres."""
    out = []
    for caster in (section(), foreign()):
        for reach_mm, reach_deg in ((28.0, 1.7), (120.0, 6.0)):
            for seed in range(COUNT):
                rng = np.random.default_rng([seed, int(reach_mm)])
                period = rng.uniform(*PERIODS_M)
                surface = reference_surface(capture_reference(measured(caster, FIRST, wave_mm, period, 99), CONFIG.weights), CONFIG)
                motion = twist(tuple(rng.uniform(-reach_mm, reach_mm, 3)), tuple(rng.uniform(-reach_deg, reach_deg, 3)))
                view = measured(caster, FIRST @ motion, wave_mm, period, seed, FIRST)
                found = register(make_matcher(surface, view, CONFIG), np.eye(4))
                if found.accepted and found.unknown.rank == 6:
                    xi = se3.log(se3.inverse(found.T_reference_now) @ motion)
                    out.append((xi @ np.linalg.solve(found.cov, xi), 1e3 * np.linalg.norm(xi[:3])))
    square, mm = np.array(out).T
    return square, mm


def test_under_usual_wiggling_errors_are_as_large_as_stated() -> None:
    """Chi-square of six, from both sides: its mean within the band of as many proposals as there are independent ones, one per scene and reach."""
    square, mm = squares(USUAL_MM)
    assert len(square) >= 0.9 * 4 * COUNT
    low, high = chi2.ppf([0.005, 0.995], 4 * 6) / 4
    assert low < square.mean() < high
    assert (square < chi2.ppf(0.99, 6)).mean() > 0.9
    assert mm.max() > 2.0, "some first proposals are wrong by millimetres"


def test_without_bias_the_covariance_is_larger_than_the_error_but_not_without_measure() -> None:
    square, mm = squares(0.0)
    assert 0.1 < square.mean() < 6.0
    assert (square < chi2.ppf(0.99, 6)).mean() > 0.9
    assert mm.max() < 1.0


def test_bias_cancels_where_a_surface_is_seen_at_the_same_range_and_angle() -> None:
    direction, normal, radial = np.array([[0.0, 0.0, 1.0]]), np.array([[0.0, 0.6, -0.8]]), np.array([0.93])
    same = sights(direction, normal, radial) - sights(direction, normal, radial)
    np.testing.assert_array_equal(same, 0.0)
    one = sights(direction, normal, radial)
    # A bias of 1 m at every knot moves the point by 1 m along its ray: -0.8 m along the normal; once by range, once by light.
    assert one.sum() == pytest.approx(2 * -0.8)
    apart = sights(direction, normal, radial + 0.05) - one
    assert 0.3 < np.abs(apart).max() < 0.8


@pytest.mark.parametrize("size_mm", [0.0, 1.0, 4.0])
def test_the_size_of_the_bias_is_what_the_residuals_state(size_mm: float) -> None:
    values = np.geomspace(8000, 2000, 12)
    rng = np.random.default_rng(1)
    drawn = [1e3 * _size(rng.normal(0, np.sqrt(1 + (1e-3 * size_mm * values) ** 2)), values, 1.0) for _ in range(40)]
    assert np.median(drawn) == pytest.approx(size_mm, abs=0.15 + 0.2 * size_mm)
    assert 1e3 * _size(np.full(3, 50.0), np.full(3, 20.0), 1.0) == pytest.approx(USUAL_MM, rel=0.01), "nothing shows: the prior"
