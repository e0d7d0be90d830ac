# SPDX-License-Identifier: Apache-2.0
"""The chain of frames and its derivatives."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.tof_align.made import CONFIG, section, session
from tof_align.chain import chain_of
from tof_core import se3
from tof_core.capture import RobotPose
from tof_core.errors import TransformError


def test_the_pose_is_base_body_arm_hand_eye_in_that_order() -> None:
    views, _ = session(section(), views=4)
    rng = np.random.default_rng(1)
    chain = chain_of(views, CONFIG.priors)
    chain = chain.moved(rng.normal(size=18) * 0.02, rng.normal(size=(4, 6)) * 0.02)
    v = 3
    robot = views[v].robot
    assert robot is not None
    expected = chain.B[1] @ robot.T_cell_body @ robot.T_body_camera @ chain.arm[v] @ chain.hand_eye
    np.testing.assert_allclose(chain.pose(v), expected, atol=1e-12)


def test_links_say_how_each_unknown_moves_the_camera() -> None:
    views, _ = session(section(), views=4)
    rng = np.random.default_rng(2)
    chain = chain_of(views, CONFIG.priors).moved(rng.normal(size=18) * 0.03, rng.normal(size=(4, 6)) * 0.03)
    for v in range(4):
        shared, own = chain.links(v)
        for k in range(18):
            x = 1e-7 * np.eye(18)[k]
            xi = se3.log(se3.inverse(chain.pose(v)) @ chain.moved(x, np.zeros((4, 6))).pose(v)) / 1e-7
            column = np.flatnonzero(chain.where(v) == k)
            expected = shared[:, column[0]] if len(column) else np.zeros(6)
            np.testing.assert_allclose(xi, expected, atol=1e-5)
        for k in range(6):
            a = np.zeros((4, 6))
            a[v, k] = 1e-7
            xi = se3.log(se3.inverse(chain.pose(v)) @ chain.moved(np.zeros(18), a).pose(v)) / 1e-7
            np.testing.assert_allclose(xi, own[:, k], atol=1e-5)


def test_a_pose_with_its_own_covariance_errs_by_it() -> None:
    views, _ = session(section(), views=3, stations=1)
    rng = np.random.default_rng(3)
    mixed = 1e-3 * rng.normal(size=(3, 6, 6))
    roots = np.linalg.cholesky(mixed @ mixed.swapaxes(1, 2) + 1e-6 * np.eye(6))
    known = [replace(v, robot=replace(v.robot, cov=r @ r.T)) for v, r in zip(views, roots, strict=True) if v.robot is not None]
    held = replace(CONFIG.priors, base_mm=1e-3, base_deg=1e-4, hand_eye_mm=1e-3, hand_eye_deg=1e-4)
    chain = chain_of(known, held)
    steps = rng.normal(size=(3, 6))
    moved = chain.moved(np.zeros(chain.globals_), steps)
    for v in range(3):
        np.testing.assert_allclose(chain.prior_cov(v), roots[v] @ roots[v].T, atol=1e-10)
        np.testing.assert_allclose(se3.log(se3.inverse(chain.pose(v)) @ moved.pose(v)), roots[v] @ steps[v], atol=1e-12)
        np.testing.assert_allclose(chain.links(v)[1], roots[v], atol=1e-12)
    info, own_info, error, own_error = moved.prior()
    np.testing.assert_allclose(own_info, np.ones(6))
    np.testing.assert_allclose(own_error, steps, atol=1e-9)
    assert info.shape == error.shape == (12,)
    last = moved.subset([2]).root
    assert last is not None
    np.testing.assert_allclose(np.asarray(last, float), np.asarray(roots[2:], float), atol=1e-15)
    partly = [*known[:2], views[2]]
    assert chain_of(partly, held).root is None


def test_the_prior_of_the_base_holds_at_the_body_and_without_a_body_among_the_cameras() -> None:
    views, _ = session(section(), views=2, stations=1)
    assert views[0].robot is not None
    np.testing.assert_allclose(chain_of(views, CONFIG.priors).pivot[0], views[0].robot.T_cell_body)
    bare = [replace(v, robot=RobotPose(np.eye(4), v.robot.T_cell_camera)) for v in views if v.robot is not None]
    middle = np.mean([v.robot.T_cell_camera[:3, 3] for v in bare if v.robot is not None], axis=0)
    np.testing.assert_allclose(chain_of(bare, CONFIG.priors).pivot[0][:3, 3], middle)


def test_a_view_without_a_robot_pose_is_refused_by_its_stamp() -> None:
    views, _ = session(section(), views=2, stations=1)
    with pytest.raises(TransformError, match=r"1 of 2 views have no robot pose \(first stamp 1000000000\)"):
        chain_of([views[0], replace(views[1], robot=None)], CONFIG.priors)


def test_the_robots_own_uncertainty_grows_with_the_lever_to_the_body() -> None:
    views, _ = session(section(), views=2, stations=1)
    std = np.sqrt(np.diag(chain_of(views, CONFIG.priors).prior_cov(0)))
    reach = np.linalg.norm(views[0].robot.T_body_camera[:3, 3])  # type: ignore[union-attr]
    assert std[:3].max() > 0.05
    assert std[:3].max() < np.hypot(0.051, np.radians(2.1) * reach)
    assert std[3:] == pytest.approx(np.radians(np.hypot(2.0, np.hypot(0.1, 0.3))), rel=1e-6)
