# SPDX-License-Identifier: Apache-2.0
"""Poses as views come in: from the past alone, and as good as the past allows."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tests.tof_align.made import CONFIG, at, foreign, look, measured, panel, pose_error, scene_of, section, session, wiggling
from tof_align.causal import SessionAligner
from tof_align.session import solve_session
from tof_core import se3
from tof_core.capture import RobotPose
from tof_core.errors import TransformError
from tof_scene.raycast import Raycaster

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tests.tof_align.made import Truth
    from tof_core.arrays import Float
    from tof_core.capture import Posed, View


def test_a_pose_depends_on_the_past_alone() -> None:
    views, _ = session(section(), views=8)
    whole, part = SessionAligner(section(), CONFIG), SessionAligner(section(), CONFIG)
    first = [whole.push(v) for v in views]
    again = [part.push(v) for v in views[:5]]
    for a, b in zip(first, again, strict=False):
        np.testing.assert_array_equal(a.T_cell_camera, b.T_cell_camera)
        np.testing.assert_array_equal(a.cov, b.cov)
    assert [v.stamp_ns for v in views] == sorted(v.stamp_ns for v in views)


def test_later_views_profit_from_earlier_ones_and_say_so() -> None:
    views, truth = session(section(), views=12, stations=1)
    aligner = SessionAligner(section(), CONFIG)
    posed = [aligner.push(v) for v in views]
    errors = [pose_error(p.T_cell_camera, t)[0] for p, t in zip(posed, truth, strict=True)]
    assert np.median(errors[4:]) < 0.3
    assert max(errors) < 2.0
    squares = [
        (xi := se3.log(se3.inverse(p.T_cell_camera) @ t.T_cell_camera)) @ np.linalg.solve(p.cov_right, xi)
        for p, t in zip(posed, truth, strict=True)
    ]
    assert np.mean(squares) < 15.0


def test_the_window_forgets_no_information() -> None:
    views, _ = session(section(), views=10, stations=1)
    wide, narrow = SessionAligner(section(), CONFIG), SessionAligner(section(), CONFIG, window=3)
    a, b = [(wide.push(view), narrow.push(view)) for view in views][-1]
    metres, degrees = se3.distance(a.T_cell_camera, b.T_cell_camera)
    assert metres < 0.05e-3
    assert degrees < 0.005
    assert np.trace(b.cov) == pytest.approx(np.trace(a.cov), rel=0.15)


def test_hand_eye_is_carried_from_station_to_station() -> None:
    X = se3.exp([4e-3, -3e-3, 5e-3, 6e-3, -4e-3, 5e-3])
    views, _ = session(section(), views=16, stations=2, X=X)
    carried = SessionAligner(section(), CONFIG)
    last = [carried.push(view) for view in views[:9]][-1]
    fresh = SessionAligner(section(), CONFIG).push(views[8])
    assert np.trace(last.cov[:3, :3]) < np.trace(fresh.cov[:3, :3])


def test_the_final_solution_is_that_of_the_whole_session() -> None:
    views, _ = session(section(), views=6, effect=wiggling)
    aligner = SessionAligner(section(), CONFIG)
    for view in views:
        aligner.push(view)
    final, direct = aligner.finish(), solve_session(views, section(), CONFIG)
    for a, b in zip(final.posed, direct.posed, strict=True):
        np.testing.assert_array_equal(a.T_cell_camera, b.T_cell_camera)


def test_a_view_of_something_else_is_refused_and_teaches_nothing() -> None:
    views, truth = session(section(), views=6, stations=1)
    other, _ = session(foreign(), views=6, stations=1)
    aligner = SessionAligner(section(), CONFIG)
    for view in views[:3]:
        aligner.push(view)
    stray = aligner.push(replace(other[3], robot=views[3].robot))
    assert not stray.accepted
    assert "fits nowhere" in stray.verdict
    assert stray.short == "fits nowhere"
    assert pose_error(stray.T_cell_camera, truth[3])[0] < 4.0  # the views before it still say where it is
    posed = aligner.push(views[4])
    assert posed.accepted
    assert pose_error(posed.T_cell_camera, truth[4])[0] < 1.0


def test_a_station_is_looked_for_until_one_of_its_views_is_accepted() -> None:
    views, truth = session(section(), views=4, stations=1)
    other, _ = session(foreign(), views=4, stations=1)
    aligner = SessionAligner(section(), CONFIG)
    posed = [aligner.push(v) for v in (replace(other[0], robot=views[0].robot), *views[1:])]
    assert [p.accepted for p in posed] == [False, True, True, True]
    assert max(pose_error(p.T_cell_camera, t)[0] for p, t in zip(posed[1:], truth[1:], strict=True)) < 2.0


def test_a_view_past_the_parts_is_refused_without_an_exception() -> None:
    views, _ = session(section(), views=3, stations=1)
    blind = replace(views[1], depth=np.full_like(views[1].depth, np.nan))
    aligner = SessionAligner(section(), CONFIG)
    assert aligner.push(views[0]).accepted
    refused = aligner.push(blind)
    assert not refused.accepted
    assert (refused.short, refused.verdict) == ("too few pixels on the CAD", "only 0 pixels see the CAD")
    assert aligner.push(views[2]).accepted


def test_a_thin_panel_keeps_the_robots_pose_live_too() -> None:
    views, _ = session(panel(), views=3, stations=1)
    aligner = SessionAligner(panel(), CONFIG)
    posed = aligner.push(views[0])
    assert views[0].robot is not None
    moved = posed.T_cell_camera[:3, 3] - views[0].robot.T_cell_camera[:3, 3]
    assert np.abs(moved[1:]).max() < 1e-4
    assert "slides along cell y" in posed.verdict
    assert posed.short == "the robot's pose in part"


def test_the_mode_of_the_robots_pose_gives_that_pose() -> None:
    views, _ = session(section(), views=2, stations=1)
    posed = SessionAligner(section(), replace(CONFIG, mode="robot")).push(views[0])
    assert views[0].robot is not None
    np.testing.assert_array_equal(posed.T_cell_camera, views[0].robot.T_cell_camera)


def test_no_robot_pose_no_output() -> None:
    views, _ = session(section(), views=2, stations=1)
    aligner = SessionAligner(section(), CONFIG)
    with pytest.raises(TransformError, match="no robot pose"):
        aligner.push(replace(views[0], robot=None))
    assert aligner.samples == []


def test_reset_forgets() -> None:
    views, _ = session(section(), views=2, stations=1)
    aligner = SessionAligner(section(), CONFIG)
    first = aligner.push(views[0])
    aligner.reset()
    np.testing.assert_array_equal(aligner.push(views[0]).T_cell_camera, first.T_cell_camera)


def squares(posed: Sequence[Posed], truth: Sequence[Truth]) -> Float:
    """(V,) squared pose errors over their covariance: 6 in the mean if it is right."""
    errors = [se3.log(se3.inverse(p.T_cell_camera) @ t.T_cell_camera) for p, t in zip(posed, truth, strict=True)]
    return np.array([xi @ np.linalg.solve(p.cov_right, xi) for xi, p in zip(errors, posed, strict=True)])


def test_a_displaced_part_neither_pulls_the_cameras_nor_makes_them_sure() -> None:
    """The bracket stands 5 mm aside of its CAD."""
    aside = at(0.003, 0.004, 0.0)
    moved = [replace(p, vertices=se3.apply(aside, p.vertices)) if p.name == "bracket" else p for p in section().scene.parts]
    cad = Raycaster(scene_of(*moved))
    views, truth = session(section(), views=24, stations=2)
    aligner = SessionAligner(cad, CONFIG)
    posed = [aligner.push(v) for v in views]
    errors = [pose_error(p.T_cell_camera, t)[0] for p, t in zip(posed, truth, strict=True)]
    assert np.median(errors[8:]) < 1.0
    assert np.median(squares(posed[8:], truth[8:])) < 12.0


def test_surfaces_that_nobody_saw_before_get_columns_and_their_place_counts() -> None:
    """The second station looks at other parts, three metres aside."""
    far = at(0.0, 3.0, 0.0)
    parts = section().scene.parts
    both = Raycaster(scene_of(*parts, *(replace(p, name=f"{p.name} 2", vertices=se3.apply(far, p.vertices)) for p in parts)))
    views, truth = session(section(), views=12, stations=2, effect=wiggling)
    there = [v if v.station == views[0].station else beside(v, far) for v in views]
    where = [t.T_cell_camera if v.station == views[0].station else far @ t.T_cell_camera for v, t in zip(views, truth, strict=True)]
    first = next(v for v in there if v.station != there[0].station)
    other, _ = session(foreign(), views=6, stations=1)
    strays = [replace(other[3], robot=first.robot, station=first.station), replace(other[3], robot=there[5].robot)]
    aligner = SessionAligner(both, CONFIG)
    posed = []
    for view in there:
        if view is first:  # views that are refused look elsewhere, too, and back again
            assert not any(aligner.push(stray).accepted for stray in strays)
        posed.append(aligner.push(view))
    assert all(p.accepted for p in posed)
    assert max(1e3 * se3.distance(p.T_cell_camera, T)[0] for p, T in zip(posed, where, strict=True)) < 3.0


def beside(view: View, far: Float) -> View:
    """The view as taken at another place of the cell."""
    assert view.robot is not None
    return replace(view, robot=replace(view.robot, T_cell_body=far @ view.robot.T_cell_body))


def test_a_view_nearer_than_any_before_has_columns_for_the_errors_of_its_range() -> None:
    """The columns of range that were chosen for far views say nothing of a wiggle at a quarter of their distance."""
    aligner, target = SessionAligner(section(), CONFIG), np.array([0.0, 0.0, 0.8])
    posed, truth = [], []
    for number, eye in enumerate([(1.35, 0.4, 1.1), (1.3, -0.4, 1.2), (0.33, -0.2, 1.0)]):
        T = look(np.array(eye), target)
        view, true = measured(
            section(), T, RobotPose(np.eye(4), T @ se3.exp([1e-3, -2e-3, 1e-3, 2e-3, 1e-3, -1e-3])), number=number, effect=wiggling
        )
        posed.append(aligner.push(view))
        truth.append(true)
    assert posed[-1].accepted
    assert pose_error(posed[-1].T_cell_camera, truth[-1])[0] < 1.5
    assert squares(posed, truth)[-1] < 12.0
