# SPDX-License-Identifier: Apache-2.0
"""Parts that stand off their CAD: their columns, what a session says of them, and what they may not do to the poses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.tof_align.expanded import part_columns
from tests.tof_align.made import CONFIG, at, label_errors, one_view, pose_error, scene_of, section, session
from tof_align.config import DiscrepancyConfig
from tof_align.linearise import Linearised, linearise
from tof_align.parts import LEAST_RADIUS_M, MOTIONS, PartFrames, no_parts, parts_of, stand_off
from tof_align.parts import counts as holding
from tof_align.pixels import take_pixels
from tof_align.session import solve_session
from tof_align.verdict import apart_in_words, disagreeing
from tof_core import se3
from tof_scene.raycast import Raycaster

NAMES = ("wall", "sill", "roof", "bracket", "block")


@pytest.fixture(scope="module")
def lin() -> Linearised:
    return at_truth(section())


def at_truth(caster: Raycaster) -> Linearised:
    view, truth = one_view(section(), np.zeros(6))
    return linearise(take_pixels(view, CONFIG.weights), truth.T_cell_camera, caster, CONFIG.weights)


def moved(name: str, motion: np.ndarray) -> Raycaster:
    """The section with one part carried by `motion` (4, 4) in the cell."""
    parts = [replace(p, vertices=se3.apply(motion, p.vertices)) if p.name == name else p for p in section().scene.parts]
    return Raycaster(scene_of(*parts))


def test_a_column_is_the_change_of_depth_when_its_part_moves(lin: Linearised) -> None:
    parts = parts_of([lin], 0.01)
    p = int(np.flatnonzero(parts.index == NAMES.index("bracket"))[0])
    unit = 2e-4
    for k in range(MOTIONS):
        motion = np.eye(4)
        if k < 3:
            motion[k, 3] = unit
        else:
            turn = se3.so3_exp(unit / parts.radius[p] * np.eye(3)[k - 3])
            motion[:3, :3], motion[:3, 3] = turn, parts.middle[p] - turn @ parts.middle[p]
        other = at_truth(moved("bracket", motion))
        both, here, there = np.intersect1d(lin.index, other.index, return_indices=True)
        assert len(both) > 0.95 * len(lin.index)
        column = part_columns(parts, lin)[here].reshape(len(both), -1, MOTIONS)[:, p, k]
        change = (other.depth[there] - lin.depth[here]) / unit
        inside = (lin.part[here] == other.part[there]) & (np.abs(change) < 20)
        np.testing.assert_allclose(column[inside], change[inside], atol=0.02)
        assert k or np.abs(column).max() > 0.1


def test_parts_that_hardly_show_have_no_columns(lin: Linearised) -> None:
    counts = np.bincount(lin.part, minlength=5)
    assert parts_of([lin], counts.max() / counts.sum()).index.size == 0, "one part alone cannot disagree"
    few = parts_of([lin], np.sort(counts)[-2] / counts.sum())
    assert sorted(few.index) == sorted(np.argsort(counts)[-2:])
    columns = part_columns(few, lin).reshape(len(lin.part), 2, MOTIONS)
    assert not columns[~np.isin(lin.part, few.index)].any()
    assert few.radius.min() > LEAST_RADIUS_M
    np.testing.assert_array_equal(holding(few, lin), np.isin(lin.part, few.index))
    assert holding(no_parts(), lin).all()


def test_stand_off_is_the_motion_along_the_normal(lin: Linearised) -> None:
    wall = PartFrames(np.array([0]), np.zeros((1, 3)), np.ones(1))
    second = np.zeros((1, 6, 6))
    second[0, 0, 0] = 0.004**2
    normal = lin.normal[lin.part == 0]
    assert stand_off(wall, [lin], second)[0] == pytest.approx(0.004 * np.sqrt((normal[:, 0] ** 2).mean()))


def test_one_part_against_the_rest_is_named_and_does_not_move_the_cameras() -> None:
    real = moved("block", at(0.008, 0.0, 0.0))
    views, truth = session(real, views=8)
    found = solve_session(views, section(), CONFIG)
    without = solve_session(views, section(), replace(CONFIG, discrepancy=DiscrepancyConfig(parts=False)))
    errors, before = ([pose_error(p.T_cell_camera, t)[0] for p, t in zip(s.posed, truth, strict=True)] for s in (found, without))
    assert np.median(errors) < 0.4
    assert np.median(errors) < 0.5 * np.median(before)
    assert all(p.accepted and p.verdict == "parts disagree with the CAD: block by 7 mm" for p in found.posed)
    assert found.posed[0].apart[NAMES.index("block")] == pytest.approx(7e-3, abs=0.5e-3)
    parts = found.posed[0].parts
    assert 5e-3 < parts[NAMES.index("block")] < 9e-3
    assert np.delete(parts, NAMES.index("block")).max() < 1e-3


def test_parts_that_agree_cost_nothing() -> None:
    views, truth = session(section(), views=8)
    found = solve_session(views, section(), CONFIG)
    assert found.posed[0].parts.max() < 0.3e-3
    labels = np.concatenate([label_errors(section(), p.T_cell_camera, t) for p, t in zip(found.posed, truth, strict=True)])
    assert np.abs(labels).mean() < 0.15e-3


def test_words_name_the_part_that_is_off_by_more_than_chance() -> None:
    apart, std = np.array([0.012, 0.004, 0.001, 0.02]), np.array([0.001, 0.003, 1e-5, 0.001])
    sure = disagreeing(apart, std, CONFIG.verdict)
    np.testing.assert_array_equal(sure, (0.012, 0.0, 0.0, 0.02))
    assert apart_in_words(("a", "b", "c", "d"), sure) == "parts disagree with the CAD: d by 20 mm, a by 12 mm"
    assert apart_in_words(("a", "b", "c", "d"), 0 * apart) == ""
