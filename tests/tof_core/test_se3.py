# SPDX-License-Identifier: Apache-2.0
"""Rigid motions: the algebra holds for any twist, small or nearly half a turn."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation, Slerp

from tof_core import se3
from tof_core.arrays import Float  # noqa: TC001 (hypothesis reads the annotations)
from tof_core.errors import TransformError

metres = st.floats(-3, 3, allow_subnormal=False)


@st.composite
def twists(draw: st.DrawFn, most: float = 3.1) -> Float:
    """Twists whose rotations span 1e-9 rad to nearly half a turn."""
    axis = np.array(draw(st.tuples(metres, metres, metres).filter(lambda v: np.linalg.norm(v) > 0.1)))
    angle = draw(st.one_of(st.floats(0, most), st.floats(-9, -1).map(lambda e: 10.0**e), st.just(0.0)))
    return np.concatenate([draw(st.tuples(metres, metres, metres)), axis / np.linalg.norm(axis) * angle])


@given(twists())
def test_log_undoes_exp(xi: Float) -> None:
    np.testing.assert_allclose(se3.log(se3.exp(xi)), xi, atol=2e-8 if np.linalg.norm(xi[3:]) > 3 else 1e-10)


@given(twists())
def test_exp_is_the_matrix_exponential(xi: Float) -> None:
    from scipy.linalg import expm

    X = np.zeros((4, 4))
    X[:3, :3], X[:3, 3] = se3.skew(xi[3:]), xi[:3]
    np.testing.assert_allclose(se3.exp(xi), expm(X), atol=1e-10)


@pytest.mark.parametrize("angle", [1e-4, 1e-5, 1e-6, 3e-7, 1e-8])
def test_small_turns_keep_their_translation(angle: float) -> None:
    xi = np.array([1.0, -2.0, 0.5, angle, -angle, 0.5 * angle])
    np.testing.assert_allclose(se3.log(se3.exp(xi)), xi, atol=1e-13, rtol=0)


@given(twists(), twists())
def test_inverse_and_composition(a: Float, b: Float) -> None:
    A, B = se3.exp(a), se3.exp(b)
    np.testing.assert_allclose(se3.inverse(A) @ A, np.eye(4), atol=1e-12)
    np.testing.assert_allclose(se3.inverse(A @ B), se3.inverse(B) @ se3.inverse(A), atol=1e-12)


@given(twists(), twists())
def test_the_adjoint_moves_a_twist_to_the_other_side(a: Float, xi: Float) -> None:
    T = se3.exp(a)
    np.testing.assert_allclose(T @ se3.exp(xi), se3.exp(se3.adjoint(T) @ xi) @ T, atol=1e-9)


@given(twists())
def test_quaternions_agree_with_scipy(xi: Float) -> None:
    T = se3.exp(xi)
    q = se3.quat_from_matrix(T[:3, :3])
    expected = Rotation.from_matrix(T[:3, :3]).as_quat(canonical=True)
    assert q[3] >= 0
    assert min(np.abs(q - expected).max(), np.abs(q + expected).max()) < 1e-12
    np.testing.assert_allclose(se3.from_quat(T[:3, 3], 3.0 * q), T, atol=1e-12)


@given(twists(), twists(most=2.9), st.floats(0, 1))
def test_interpolation_is_linear_and_slerp(a: Float, b: Float, share: float) -> None:
    A, B = se3.exp(a), se3.exp(a) @ se3.exp(b)
    T = se3.interpolate(A, B, share)
    np.testing.assert_allclose(T[:3, 3], (1 - share) * A[:3, 3] + share * B[:3, 3], atol=1e-12)
    slerp = Slerp([0, 1], Rotation.from_matrix([A[:3, :3], B[:3, :3]]))(share).as_matrix()
    np.testing.assert_allclose(T[:3, :3], slerp, atol=1e-9)


@given(twists(), twists())
def test_covariance_goes_to_fixed_axes_and_back(a: Float, xi: Float) -> None:
    T = se3.exp(a)
    cov = np.outer(xi, xi) + np.eye(6)
    np.testing.assert_allclose(se3.cov_right(T, se3.cov_fixed_axes(T, cov)), cov, atol=1e-9)


def test_fixed_axes_covariance_is_that_of_sampled_poses() -> None:
    random = np.random.default_rng(3)
    T = se3.exp([0.4, -0.2, 1.0, 0.5, 1.1, -0.7])
    root = np.diag([1e-3, 2e-3, 3e-3, 1e-3, 4e-3, 2e-3])
    twists = random.standard_normal((20000, 6)) @ root
    moved = np.array([T @ se3.exp(x) for x in twists])
    turns = np.array([se3.so3_log(M[:3, :3] @ T[:3, :3].T) for M in moved])
    sampled = np.cov(np.hstack([moved[:, :3, 3] - T[:3, 3], turns]).T)
    np.testing.assert_allclose(sampled, se3.cov_fixed_axes(T, root @ root), atol=4e-7)


def test_distance_is_metres_and_degrees() -> None:
    metres, degrees = se3.distance(np.eye(4), se3.exp([0, 0, 0, 0, 0, np.radians(30)]) @ se3.exp([3, 4, 0, 0, 0, 0]))
    assert metres == pytest.approx(5.0)
    assert degrees == pytest.approx(30.0)


def test_points_are_moved() -> None:
    T = se3.exp([1, 2, 3, 0, 0, np.pi / 2])
    T[:3, 3] = [1, 2, 3]
    np.testing.assert_allclose(se3.apply(T, [[1.0, 0, 0], [0, 1.0, 0]]), [[1, 3, 3], [0, 2, 3]], atol=1e-12)


def changed(row: int, column: int, value: float) -> Float:
    """The identity but for one entry."""
    T = np.eye(4)
    T[row, column] = value
    return T


@pytest.mark.parametrize(
    "T",
    [
        np.eye(3),
        np.full((4, 4), np.nan),
        changed(0, 3, np.nan),
        np.diag([1.0, 1, 1.1, 1]),
        np.diag([1.0, 1, -1, 1]),
        changed(3, 0, 1e-6),
        changed(3, 1, -1e-6),
        changed(0, 1, 2e-4),
    ],
)
def test_a_matrix_that_is_no_rigid_motion_is_refused_by_name(T: Float) -> None:
    with pytest.raises(TransformError, match="initial pose"):
        se3.as_se3("initial pose", T)


def test_a_rounded_rotation_is_made_orthogonal() -> None:
    T = np.round(se3.exp([1, 2, 3, 0.3, 0.4, 0.5]), 5)
    projected = se3.as_se3("T", T)
    np.testing.assert_allclose(projected[:3, :3] @ projected[:3, :3].T, np.eye(3), atol=1e-14)
    np.testing.assert_allclose(projected, T, atol=1e-5)


def test_a_quaternion_without_direction_is_refused() -> None:
    with pytest.raises(TransformError, match="no direction"):
        se3.from_quat([0, 0, 0], [0, 0, 0, 0])


def test_a_cross_product_matrix_of_each_vector() -> None:
    v, w = np.array([[1.0, 2.0, 3.0], [-4.0, 0.5, 6.0]]), np.array([0.3, -0.7, 1.1])
    assert se3.skew(v).shape == (2, 3, 3)
    np.testing.assert_allclose(se3.skew(v) @ w, np.cross(v, w))
