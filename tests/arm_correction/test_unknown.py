# SPDX-License-Identifier: Apache-2.0
"""Directions that a registration leaves open, and its covariance, against least squares written out."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from arm_correction.bias import KNOTS, LIGHT, RANGE_M, _hats, _size, bias_covariance, sights
from arm_correction.config import TrustConfig
from arm_correction.unknown import LEVER_M, SCALE, Unknown, _span, inflation_of, smallest_motion, unknown_directions
from tests.arm_correction.made import twist
from tof_core import se3

if TYPE_CHECKING:
    from tof_core.arrays import Float

TRUST = TrustConfig(chance=0.35, known_mm=2.0, known_deg=0.3)
SIGN = np.tile([1.0, -1.0], 60)
"""Residuals of one standard deviation that neighbours do not share: their inflation is 1."""


def corner(count: int = 120) -> tuple[Float, Float, Float]:
    """Points on three faces of a corner, their normals, and the derivative of n . point by a right perturbation."""
    rng = np.random.default_rng(2)
    normal = np.eye(3)[np.arange(count) % 3] * -1.0
    points = rng.uniform(-0.3, 0.3, (count, 3)) + np.array([0, 0, 0.8])
    return points, normal, np.concatenate([normal, np.cross(points, normal)], axis=1)


def test_without_noise_of_the_normals_the_covariance_is_that_of_least_squares() -> None:
    points, _, J = corner()
    weight = np.linspace(1e6, 3e6, 120)
    e = SIGN / np.sqrt(weight)
    unknown, cov = unknown_directions(e, J, weight, np.zeros(120), points, TRUST)
    assert unknown.rank == 6
    assert unknown.names == ()
    np.testing.assert_allclose(cov, np.linalg.inv((J * weight[:, None]).T @ J), rtol=1e-6)
    twice = unknown_directions(2 * e, J, weight, np.zeros(120), points, TRUST)[1]
    np.testing.assert_allclose(twice, 4 * cov, rtol=1e-9)


def test_information_that_noise_of_the_normals_feigns_is_taken_off() -> None:
    """A normal that is off by tilt lets a slide across it look like distance: w tilt^2 A' (1 - n n') A, with A the motion of the point."""
    points, normal, J = corner()
    weight, tilt = np.full(120, 1e6), np.linspace(0.1, 0.3, 120)
    feigned = np.zeros((6, 6))
    for p, n, t in zip(points, normal, tilt, strict=True):
        A = np.concatenate([np.eye(3), -se3.skew(p)], axis=1)
        feigned += 1e6 * t**2 * A.T @ (np.eye(3) - np.outer(n, n)) @ A
    unknown, cov = unknown_directions(SIGN * 1e-3, J, weight, tilt, points, TRUST)
    assert unknown.rank == 6
    np.testing.assert_allclose(cov, np.linalg.inv((J * weight[:, None]).T @ J - feigned), rtol=1e-6)


@pytest.mark.parametrize(("share", "rank"), [(0.33, 6), (0.37, 5)])
def test_a_direction_of_which_too_large_a_share_is_feigned_is_open(share: float, rank: int) -> None:
    """Four of five points tell about slides along z, one about x: the former feign w tilt^2 of information about x, beside real w."""
    normal = np.array([[0.0, 0, -1]] * 4 + [[-1.0, 0, 0]])
    normal = np.concatenate([np.tile(normal, (24, 1)), np.tile([[0.0, -1, 0]], (120, 1))])
    points = np.random.default_rng(5).uniform(-1, 1, (240, 3))
    J = np.concatenate([normal, np.cross(points, normal)], axis=1)
    tilt = np.where(normal[:, 2] != 0, np.sqrt(share / (1 - share) / 4 * 0.999), 0.0)
    weight = np.full(240, 1e9)
    feigned_x, all_x = (weight * tilt**2).sum(), (weight * normal[:, 0] ** 2).sum()
    assert feigned_x / all_x == pytest.approx(share / (1 - share), rel=0.01)
    e = np.tile(SIGN, 2) / np.sqrt(weight)
    loose = TrustConfig(chance=share / (1 - share) * (1.3 if rank == 6 else 0.7), known_mm=1e3, known_deg=90.0)
    assert unknown_directions(e, J, weight, tilt, points, loose)[0].rank == rank


def axis_by_axis(std: Float) -> tuple[Float, Float, Float, Float]:
    """Residuals, derivative, weight and points of 120 pixels that know each of the six axes by itself, to `std` (6,).

    Pairs on either side of the middle: along their normal both know the slide, across it their distance knows the turn.
    """
    turned_by = {2: (1, 0), 0: (2, 1), 1: (0, 2)}  # normal: axis of the points, axis of the turn
    rows, points, weight = [], [], []
    for normal, (place, turn) in turned_by.items():
        w = 1.0 / (40 * std[normal] ** 2)
        lever = 1.0 / (np.sqrt(40 * w) * std[3 + turn])
        for side in (-lever, lever):
            n, p = np.eye(3)[normal], side * np.eye(3)[place]
            rows += [np.concatenate([n, np.cross(p, n)])] * 20
            points += [p] * 20
            weight += [w] * 20
    return SIGN / np.sqrt(weight), np.array(rows), np.array(weight), np.array(points)


@pytest.mark.parametrize("axis", range(6))
@pytest.mark.parametrize(("factor", "known"), [(0.98, True), (1.02, False)])
def test_a_direction_less_certain_than_its_limit_is_open(axis: int, factor: float, *, known: bool) -> None:
    """Five axes are ten times better known than the limits, one is just at its own."""
    limit = np.repeat([2e-3, np.radians(0.3)], 3)
    std = 0.1 * limit
    std[axis] = factor * limit[axis]
    e, J, weight, points = axis_by_axis(std)
    unknown, cov = unknown_directions(e, J, weight, np.zeros(120), points, TRUST)
    expected = std**2
    if known:
        assert unknown.rank == 6
    else:
        assert unknown.rank == 5
        assert unknown.names == (f"{'slides along' if axis < 3 else 'turns about'} camera {'xyz'[axis % 3]}",)
        expected[axis] += 1.0 / SCALE[axis] ** 2
    np.testing.assert_allclose(np.diag(cov), expected, rtol=1e-6)


def test_what_is_not_measured_at_all_has_a_finite_covariance() -> None:
    e, J, weight, points = axis_by_axis(np.array([2e-4, 2e-4, 2e-4, 5e-4, 5e-4, 1e9]))
    unknown, cov = unknown_directions(e, J, weight, np.zeros(120), points, TRUST)
    assert unknown.names == ("turns about camera z",)
    assert 1.0 / LEVER_M**2 <= cov[5, 5] < 1.1 / LEVER_M**2


def test_neighbours_that_err_together_inflate_the_variance() -> None:
    ones = np.full(48, 4.0)
    assert inflation_of(np.full(48, 0.5), ones) == pytest.approx(12.0)
    assert inflation_of(SIGN[:48] * 0.5, ones) == pytest.approx(1.0)
    assert inflation_of(SIGN[:48] * 1.5, ones) == pytest.approx(9.0)
    assert inflation_of(np.full(48, 1e-3), ones) == 0.1
    assert inflation_of(np.full(48, 0.5), ones, run=24) == pytest.approx(24.0)
    # Of 25 residuals a run of 24 counts; the last one by itself.
    assert inflation_of(np.append(np.ones(24), 0.0), np.ones(25), run=24) == pytest.approx(24.0)


@pytest.mark.parametrize(("degrees", "count"), [(0.0, 1), (10.0, 1), (25.0, 2), (90.0, 2)])
def test_directions_that_nearly_agree_are_one(degrees: float, count: int) -> None:
    a, b = np.eye(6)[0], np.cos(np.radians(degrees)) * np.eye(6)[0] + np.sin(np.radians(degrees)) * np.eye(6)[1]
    basis = _span(np.stack([a, b]))
    assert basis.shape == (count, 6)
    np.testing.assert_allclose(basis @ basis.T, np.eye(count), atol=1e-12)
    np.testing.assert_allclose(basis[:, 2:], 0.0, atol=1e-12)


def test_nothing_open_spans_nothing() -> None:
    assert _span(np.zeros((0, 6))).shape == (0, 6)


@pytest.mark.parametrize("null", [np.eye(6)[:2], np.eye(6)[[3]], np.eye(6)[[0, 5]], _span(np.array([[1.0, 0, 0, 0, 1.0, 0]]))])
def test_the_smallest_motion_has_nothing_of_the_open_directions(null: Float) -> None:
    T = twist((40, -30, 20), (8, -5, 3))
    small = smallest_motion(T, null)
    np.testing.assert_allclose(null @ (SCALE * se3.log(small)), 0.0, atol=1e-8)
    assert np.linalg.norm(SCALE * se3.log(small)) < np.linalg.norm(SCALE * se3.log(T))


def test_without_open_directions_the_motion_stays() -> None:
    T = twist((40, -30, 20), (8, -5, 3))
    np.testing.assert_allclose(smallest_motion(T, np.zeros((0, 6))), T, atol=1e-15)


def test_a_bias_is_read_at_its_range_and_at_its_light() -> None:
    """Linear between knots: the mean knot of each half of the columns is the place on its scale."""
    direction, normal = np.array([[0.0, 0.0, 1.0], [0.6, 0.0, 0.8]]), np.array([[0.0, 0.6, -0.8], [1.0, 0.0, 0.0]])
    radial = np.array([0.93, 1.4])
    cosine = np.array([-0.8, 0.6])
    by_range, by_light = np.split(sights(direction, normal, radial), 2, axis=1)
    number = np.arange(KNOTS) - KNOTS // 2
    np.testing.assert_allclose(by_range.sum(axis=1), cosine)
    np.testing.assert_allclose(by_range @ number * RANGE_M, cosine * radial)
    np.testing.assert_allclose(by_light.sum(axis=1), cosine)
    np.testing.assert_allclose(by_light @ number * LIGHT, cosine * np.log(np.abs(cosine) / radial**2))


def test_grazing_light_has_a_least_angle() -> None:
    out = sights(np.array([[0.0, 0.0, 1.0]]), np.array([[1.0, 0.0, -0.01]]), np.array([1.0]))
    number = np.arange(KNOTS) - KNOTS // 2
    assert out[0, KNOTS:] @ number * LIGHT == pytest.approx(-0.01 * np.log(0.05))


def test_beyond_the_knots_the_outermost_count() -> None:
    out = _hats(np.array([-1e4, 1e4, 0.0]), 0.1)
    assert out[0, 0] == 1.0
    assert out[1, -1] == pytest.approx(1.0, abs=2e-3)
    assert out[2, KNOTS // 2] == 1.0
    np.testing.assert_allclose(out.sum(axis=1), 1.0)


def biased(unknown: Unknown, share: float = 1.0, axis: int = 0) -> tuple[Float, float]:
    """The covariance by a bias that moves the pose along an axis by `share` of it, and shows beside it in residuals of 3 mm; its size."""
    rng = np.random.default_rng(7)
    Q = np.linalg.qr(rng.normal(size=(240, 7)))[0]
    J, shows = Q[:, :6] * SCALE, Q[:, 6]
    weight = np.full(240, 4e8)
    D = np.stack([share * J[:, axis] + shows, 1e-7 * rng.normal(size=240)], axis=1)
    e = 3e-3 * shows
    size = _size(np.array([np.sqrt(4e8) * 3e-3]), np.array([np.sqrt(4e8)]), 2.0)
    return bias_covariance(e, J, weight, D, unknown, 2.0), size


def test_the_bias_that_a_pose_takes_has_the_size_that_residuals_state() -> None:
    for share, axis in ((1.0, 0), (0.5, 2), (-0.5, 4)):
        cov, size = biased(Unknown(np.zeros((0, 6)), ()), share, axis)
        expected = np.zeros((6, 6))
        expected[axis, axis] = (share * size) ** 2
        np.testing.assert_allclose(cov, expected, atol=1e-12)
        assert 2e-3 < size < 5e-3


def test_along_open_directions_and_without_a_bias_nothing_is_added() -> None:
    np.testing.assert_allclose(biased(Unknown(np.eye(6)[:1], ("x",)))[0], 0.0, atol=1e-12)
    np.testing.assert_array_equal(biased(Unknown.all_())[0], 0.0)
    J = np.tile(np.eye(6), (20, 1))
    none = bias_covariance(np.ones(120), J, np.ones(120), np.zeros((120, 3)), Unknown(np.zeros((0, 6)), ()), 1.0)
    np.testing.assert_array_equal(none, np.zeros((6, 6)))
