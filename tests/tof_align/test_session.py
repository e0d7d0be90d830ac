# SPDX-License-Identifier: Apache-2.0
"""The session solution: every link found, unmodelled errors kept from moving it, extra columns fitted beside it."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from scipy.stats import chi2

from tests.tof_align.made import (
    CONFIG,
    Seen,
    Truth,
    amplitude_bias,
    drift,
    foreign,
    label_errors,
    panel,
    pose_error,
    section,
    session,
    true_depth,
    wiggling,
)  # fmt: skip
from tof_align.fit import Fitter
from tof_align.session import SessionSolution, solve_session
from tof_core import se3
from tof_core.errors import RefusedError

if TYPE_CHECKING:
    from tof_align.terms import PosedView
    from tof_core.arrays import Float

X_SIGMA = CONFIG.priors.hand_eye
EFFECTS = {"wiggling": wiggling, "amplitude_bias": amplitude_bias, "drift": drift}


def honest(solution: SessionSolution, truth: list[Truth]) -> float:
    """Share of label errors within twice the deviation that the pose's covariance gives."""
    inside: list[float] = []
    for posed, true in zip(solution.posed, truth, strict=True):
        z, _ = true_depth(section(), posed.T_cell_camera)
        error = z - true.depth
        lin = solution.system.views[len(inside)]
        sigma = np.sqrt(np.einsum("ij,jk,ik->i", lin.jacobian, posed.cov_right, lin.jacobian))
        e = np.abs(error.ravel()[lin.index])
        inside.append(float((e < 2 * np.hypot(sigma, 0.02e-3))[e < 0.02].mean()))
    return float(np.mean(inside))


def unmodelled(solution: SessionSolution) -> float:
    """Metres: the largest size but that of the lens, which no calibration knows better than its least one."""
    return max(size for kind, size in solution.sizes.items() if kind != "lens")


def test_with_noise_alone_every_link_is_found() -> None:
    X = se3.exp([2e-3, -1e-3, 1.5e-3, 2e-3, -3e-3, 1e-3])
    views, truth = session(section(), views=10, X=X)
    found = solve_session(views, section(), CONFIG)
    errors = [pose_error(p.T_cell_camera, t) for p, t in zip(found.posed, truth, strict=True)]
    assert np.median([mm for mm, _ in errors]) < 0.15
    assert np.median([deg for _, deg in errors]) < 0.02
    labels = np.concatenate([label_errors(section(), p.T_cell_camera, t) for p, t in zip(found.posed, truth, strict=True)])
    assert np.abs(labels).mean() < 0.1e-3
    xi = se3.log(se3.inverse(found.X) @ X)
    low, high = chi2.ppf([0.005, 0.995], 6)
    assert low < xi @ np.linalg.solve(found.X_cov, xi) < high, "neither too sure nor too cautious"
    assert unmodelled(found) < 0.15e-3
    assert all(p.accepted and p.verdict == "ok" for p in found.posed)
    for v, posed in enumerate(found.posed):
        robot = views[v].robot
        assert robot is not None
        chain = found.B[v // 5] @ robot.T_cell_body @ robot.T_body_camera @ found.A[v] @ found.X
        np.testing.assert_allclose(posed.T_cell_camera, chain, atol=1e-12)


@pytest.mark.parametrize("name", EFFECTS)
def test_an_unmodelled_effect_neither_moves_hand_eye_nor_hides_in_certainty(name: str) -> None:
    views, truth = session(section(), views=12, effect=EFFECTS[name])
    found = solve_session(views, section(), CONFIG)
    assert np.abs(se3.log(found.X) / X_SIGMA).max() < 3.0
    assert honest(found, truth) > 0.9
    per_view = solve_session(views, section(), replace(CONFIG, mode="per_view"))
    ours, theirs = (np.median([pose_error(p.T_cell_camera, t)[0] for p, t in zip(s.posed, truth, strict=True)]) for s in (found, per_view))
    assert ours < 0.4 * theirs


def test_without_the_discrepancy_the_same_effect_is_believed() -> None:
    views, truth = session(section(), views=12, effect=wiggling)
    naive = solve_session(views, section(), replace(CONFIG, discrepancy=replace(CONFIG.discrepancy, enabled=False)))
    assert honest(naive, truth) < 0.6


def waves_of_each_view(seen: Seen) -> Float:
    """3 mm waves of depth, at another phase in each view."""
    return np.asarray(3e-3 * np.sin(2 * np.pi * seen.depth / 0.2 + 1.9 * seen.view))


def test_one_linearisation_more_changes_neither_sizes_nor_poses(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tof_align.fit.NEAR", 0.0)
    views, _ = session(section(), views=6, effect=waves_of_each_view)
    even, odd = (solve_session(views, section(), replace(CONFIG, iterations=count)) for count in (5, 6))
    assert even.sizes["object"] == pytest.approx(odd.sizes["object"], rel=0.15)
    for a, b in zip(even.posed, odd.posed, strict=True):
        step = se3.log(se3.inverse(a.T_cell_camera) @ b.T_cell_camera)
        assert np.abs(step / np.sqrt(np.diag(b.cov_right))).max() < 0.2


def test_the_iteration_ends_where_steps_are_small_beside_the_deviations(monkeypatch: pytest.MonkeyPatch) -> None:
    once, rounds = Fitter.once, []

    def counted(self: Fitter, *args: Any) -> Any:
        rounds.append(self)
        return once(self, *args)

    monkeypatch.setattr(Fitter, "once", counted)
    views, _ = session(section(), views=6, effect=waves_of_each_view)
    solve_session(views, section(), replace(CONFIG, iterations=12))
    assert len(rounds) < 8


def test_extra_columns_are_fitted_beside_the_poses() -> None:
    views, truth = session(section(), views=10, effect=wiggling)

    def wave(posed: PosedView) -> np.ndarray:
        reach = posed.rendering.depth.astype(float) * posed.view.camera.ray_length()
        phase = 2 * np.pi * reach / 0.375
        return np.stack([np.sin(phase), np.cos(phase)], axis=-1).reshape(-1, 2)

    found = solve_session(views, section(), CONFIG, terms=wave)
    expected = 3e-3 * np.sqrt(2) * np.array([np.cos(0.7), np.sin(0.7)])
    np.testing.assert_allclose(found.theta, expected, atol=0.15e-3)
    assert np.sqrt(np.diag(found.theta_cov)).max() < 0.2e-3
    assert unmodelled(found) < 0.3e-3
    tight = solve_session(views, section(), CONFIG, terms=wave, theta_std=np.full(2, 1e-6))
    assert np.abs(tight.theta).max() < 5e-6
    assert len(truth) == 10


def test_a_thin_panel_keeps_the_robots_pose_of_the_base_where_it_slides() -> None:
    views, truth = session(panel(), views=4, stations=1)
    found = solve_session(views, panel(), CONFIG)
    assert [n.split(" (")[0] for n in found.observability[0].names] == ["slides along cell y", "slides along cell z", "turns about cell x"]
    middle = np.mean([v.robot.T_cell_camera[:3, 3] for v in views if v.robot is not None], axis=0)
    assert np.abs((se3.apply(found.B[0], middle) - middle)[1:]).max() < 1e-4
    assert abs(np.degrees(se3.so3_log(found.B[0][:3, :3])[0])) < 0.01
    assert found.posed[0].null.shape == (3, 6)
    labels = np.concatenate([label_errors(panel(), p.T_cell_camera, t) for p, t in zip(found.posed, truth, strict=True)])
    assert np.abs(labels).mean() < 0.3e-3
    assert np.sqrt(np.diag(found.posed[0].cov))[1:3].min() > 0.03


def test_modes_without_a_session_give_a_free_pose_per_view_or_the_robots_own() -> None:
    views, truth = session(section(), views=4)
    robot = solve_session(views, section(), replace(CONFIG, mode="robot"))
    for view, posed in zip(views, robot.posed, strict=True):
        assert view.robot is not None
        np.testing.assert_array_equal(posed.T_cell_camera, view.robot.T_cell_camera)
    free = solve_session(views, section(), replace(CONFIG, mode="per_view"))
    assert np.median([pose_error(p.T_cell_camera, t)[0] for p, t in zip(free.posed, truth, strict=True)]) < 0.3
    np.testing.assert_array_equal(free.X, np.eye(4))


def test_a_view_that_sees_another_scene_is_refused_alone_and_pulls_nothing() -> None:
    views, truth = session(section(), views=6)
    other, _ = session(foreign(), views=6)
    mixed = [*views[:5], replace(other[5], robot=views[5].robot)]
    found = solve_session(mixed, section(), CONFIG)
    assert [p.accepted for p in found.posed] == [True] * 5 + [False]
    assert max(pose_error(p.T_cell_camera, t)[0] for p, t in zip(found.posed[:5], truth, strict=False)) < 1.5


def test_a_session_of_another_scene_is_refused() -> None:
    views, _ = session(foreign(), views=4)
    with pytest.raises(RefusedError, match="fits nowhere"):
        solve_session(views, section(), CONFIG)


def test_no_views_are_refused() -> None:
    with pytest.raises(RefusedError, match="no views"):
        solve_session([], section(), CONFIG)


def test_the_same_session_gives_the_same_numbers() -> None:
    views, _ = session(section(), views=4)
    one, two = (solve_session(views, section(), CONFIG) for _ in range(2))
    for a, b in zip(one.posed, two.posed, strict=True):
        np.testing.assert_array_equal(a.T_cell_camera, b.T_cell_camera)
