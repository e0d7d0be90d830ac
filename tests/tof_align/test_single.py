# SPDX-License-Identifier: Apache-2.0
"""One view to the CAD: found, said how well, and left alone where the data do not say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.tof_align.made import (
    CONFIG,
    ROBOT,
    foreign,
    label_errors,
    look,
    measured,
    one_view,
    panel,
    pose_error,
    scene_of,
    section,
    session,
    wiggling,
)
from tof_align.linearise import linearise
from tof_align.pixels import sample
from tof_align.single import align_view
from tof_core import se3
from tof_core.capture import RobotPose, View
from tof_core.errors import RefusedError
from tof_scene.raycast import Raycaster

COV = np.diag(ROBOT**2)
OFF = np.array([0.03, -0.02, 0.04, 0.02, -0.025, 0.015])


def robot(view: View) -> np.ndarray:
    assert view.robot is not None
    return view.robot.T_cell_camera


def test_a_robot_50_mm_and_2_degrees_off_is_found_to_a_tenth_of_a_millimetre() -> None:
    view, truth = one_view(section(), OFF)
    found = align_view(view, section(), robot(view), COV, CONFIG)
    mm, degrees = pose_error(found.posed.T_cell_camera, truth)
    assert mm < 0.25
    assert degrees < 0.02
    assert found.posed.accepted
    assert found.posed.verdict == "ok"
    assert found.rank == 6
    assert found.verdict.fit.support > 0.95
    assert found.verdict.seed.support < 0.5
    assert found.verdict.step_mm == pytest.approx(1000 * np.linalg.norm(OFF[:3]), rel=0.05)


def test_the_stated_covariance_covers_the_error() -> None:
    squares = []
    for seed in range(12):
        view, truth = one_view(section(), OFF, seed=seed)
        found = align_view(view, section(), robot(view), COV, CONFIG)
        xi = se3.log(se3.inverse(found.posed.T_cell_camera) @ truth.T_cell_camera)
        squares.append(xi @ np.linalg.solve(found.posed.cov_right, xi))
    assert 0.5 < np.mean(squares) < 12.0  # six degrees of freedom


def test_the_hessian_is_the_second_derivative_of_the_weighted_cost() -> None:
    view, _ = one_view(section(), np.zeros(6))
    found = align_view(view, section(), robot(view), COV, CONFIG)
    lin, weight = found.system.views[0], found.system.weights[0]
    pixels = sample(view, CONFIG.weights).full

    def cost(xi: np.ndarray) -> float:
        there = linearise(pixels, lin.T_cell_camera @ se3.exp(xi), section(), CONFIG.weights)
        full = np.full(pixels.index.size, np.nan)
        full[there.cell] = there.residual
        e = full[lin.cell]
        e = np.where(np.isfinite(e) & (np.abs(e - lin.residual) < 2e-3), e, lin.residual)
        return 0.5 * float((weight * e * e).sum())

    h = np.repeat([2e-5, 2e-5], 3)
    for k in range(6):
        d = h[k] * np.eye(6)[k]
        second = (cost(d) - 2 * cost(np.zeros(6)) + cost(-d)) / h[k] ** 2
        assert second == pytest.approx(found.hessian[k, k], rel=0.03)


@settings(max_examples=8)
@given(st.integers(0, 2**32 - 1))
def test_moving_part_and_robot_together_gives_the_same_answer_moved(seed: int) -> None:
    rng = np.random.default_rng(seed)
    move = se3.exp(np.concatenate([rng.uniform(-2, 2, 3), rng.uniform(-2, 2, 3)]))
    caster = section()
    moved = Raycaster(scene_of(*(replace(p, vertices=se3.apply(move, p.vertices)) for p in caster.scene.parts)))
    view, _ = one_view(caster, OFF)
    here = align_view(view, caster, robot(view), COV, CONFIG)
    there = align_view(view, moved, move @ robot(view), COV, CONFIG)
    metres, degrees = se3.distance(there.posed.T_cell_camera, move @ here.posed.T_cell_camera)
    assert metres < 2e-6
    assert degrees < 2e-4
    np.testing.assert_allclose(there.posed.cov_right, here.posed.cov_right, rtol=0.02, atol=1e-12)


def test_without_a_prior_it_is_the_papers_icp_and_carries_the_sensors_bias() -> None:
    view, truth = one_view(section(), OFF, effect=wiggling)
    free = align_view(view, section(), robot(view), None, CONFIG)
    assert free.sizes == {}
    careful = align_view(view, section(), robot(view), COV, CONFIG)
    assert pose_error(free.posed.T_cell_camera, truth)[0] > 2.0
    assert pose_error(careful.posed.T_cell_camera, truth)[0] < 0.5 * pose_error(free.posed.T_cell_camera, truth)[0]


def test_a_bias_nobody_modelled_widens_the_covariance() -> None:
    plain, _ = one_view(section(), OFF)
    waved, truth = one_view(section(), OFF, effect=wiggling)
    sure = align_view(plain, section(), robot(plain), COV, CONFIG).posed
    unsure = align_view(waved, section(), robot(waved), COV, CONFIG).posed
    assert np.trace(unsure.cov[:3, :3]) > 4 * np.trace(sure.cov[:3, :3])
    xi = se3.log(se3.inverse(unsure.T_cell_camera) @ truth.T_cell_camera)
    assert xi @ np.linalg.solve(unsure.cov_right, xi) < 40.0


def test_a_missing_part_and_a_foreign_object_do_not_pull() -> None:
    view, truth = one_view(section(), OFF)
    found = align_view(disturbed(view, 35), section(), robot(view), COV, CONFIG)
    mm, degrees = pose_error(found.posed.T_cell_camera, truth)
    assert mm < 0.5
    assert degrees < 0.04
    assert 0.5 < found.verdict.fit.support < 0.92


def disturbed(view: View, column: int) -> View:
    """With a foreign object before the parts from this column on, and a hole elsewhere."""
    depth = view.depth.copy()
    depth[20:50, column : column + 32] -= 0.08
    depth[55:70, 70:90] += 0.15
    return replace(view, depth=depth)


def test_where_most_of_what_tells_a_slide_is_covered_the_rest_does_not_vouch_for_it() -> None:
    view, _ = one_view(section(), OFF)
    found = align_view(disturbed(view, 20), section(), robot(view), COV, CONFIG)
    assert found.verdict.fit.support > 0.8
    assert not found.posed.accepted
    assert "how it slides along cell y" in found.posed.verdict
    np.testing.assert_array_equal(found.posed.T_cell_camera, robot(view))


@pytest.mark.parametrize("seed", range(5))
def test_without_the_parts_that_tell_a_slide_no_wrong_pose_is_accepted(seed: int) -> None:
    """Wall, sill and roof agree wherever they are slid to: nine tenths of the pixels vouched for poses 190 mm off."""
    bare = Raycaster(section().scene.without("block").without("bracket"))
    T = look(np.array([0.9, 0.1 * seed - 0.2, 0.9]), np.array([0.0, 0.1 * seed - 0.2, 0.8]))
    error = np.random.default_rng(seed).normal(size=6) * ROBOT
    view, truth = measured(bare, T, RobotPose(np.eye(4), T @ se3.exp(-error)), number=seed)
    found = align_view(view, section(), robot(view), COV, CONFIG)
    xi = se3.log(se3.inverse(found.posed.T_cell_camera) @ truth.T_cell_camera)
    assert not found.posed.accepted or xi @ np.linalg.solve(found.posed.cov_right, xi) < 20.0


def test_a_thin_panel_keeps_the_robots_pose_where_it_slides() -> None:
    view, truth = session(panel(), views=1, stations=1, base=(30.0, 1.0))
    v, t = view[0], truth[0]
    found = align_view(v, panel(), robot(v), COV, CONFIG)
    assert found.rank == 3
    assert [n.split(" (")[0] for n in found.observability.names] == ["slides along cell y", "slides along cell z", "turns about cell x"]
    moved = found.posed.T_cell_camera[:3, 3] - robot(v)[:3, 3]
    assert np.abs(moved[1:]).max() < 1e-4
    turned = se3.so3_log(found.posed.T_cell_camera[:3, :3] @ robot(v)[:3, :3].T)
    assert np.degrees(abs(turned[0])) < 0.02
    assert np.median(np.abs(label_errors(panel(), found.posed.T_cell_camera, t))) < 2e-4
    std = np.sqrt(np.diag(found.posed.cov))
    assert std[1:3].min() > 0.04
    assert std[0] < 0.01
    assert "slides along cell y (data nothing, robot" in found.posed.verdict


def test_a_scene_that_fits_nowhere_is_refused_and_the_robots_pose_kept() -> None:
    view, _ = one_view(foreign(), OFF)
    found = align_view(view, section(), robot(view), COV, CONFIG)
    assert not found.posed.accepted
    assert "fits nowhere" in found.posed.verdict
    np.testing.assert_array_equal(found.posed.T_cell_camera, robot(view))


def test_a_view_far_beyond_what_the_robots_error_allows_is_refused() -> None:
    view, _ = one_view(section(), np.array([0.06, 0, 0.06, 0, 0, 0]))
    found = align_view(view, section(), robot(view), np.diag(np.repeat([0.003, np.radians(0.3)], 3) ** 2), CONFIG)
    assert not found.posed.accepted
    np.testing.assert_array_equal(found.posed.T_cell_camera, robot(view))


def test_a_view_past_the_parts_is_refused() -> None:
    T = se3.from_quat([1.0, 0, 5.0], [0, 0, 0, 1])
    view, _ = measured(section(), one_view(section(), np.zeros(6))[1].T_cell_camera, RobotPose(np.eye(4), T))
    with pytest.raises(RefusedError, match="no view sees the CAD"):
        align_view(view, section(), T, COV, CONFIG)


@pytest.mark.parametrize("seed", range(6))
def test_a_rough_first_guess_of_200_mm_and_10_degrees_converges(seed: int) -> None:
    rng = np.random.default_rng(seed)
    v, w = rng.normal(size=3), rng.normal(size=3)
    error = np.concatenate([0.2 * v / np.linalg.norm(v), np.radians(10) * w / np.linalg.norm(w)])
    view, truth = one_view(section(), error)
    rough = np.diag(np.repeat([0.2, np.radians(10.0)], 3) ** 2)
    found = align_view(view, section(), robot(view), rough, CONFIG)
    mm, degrees = pose_error(found.posed.T_cell_camera, truth)
    assert mm < 0.5
    assert degrees < 0.05
