# SPDX-License-Identifier: Apache-2.0
"""Open directions: found against the robot's own certainty, and named."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.tof_align.made import ROBOT
from tof_align.config import VerdictConfig
from tof_align.observability import Observability, _tidy, describe, most_disputed, observe, observe_block, pinned, spread
from tof_core import se3

EYE, ORIGIN = np.eye(4), np.zeros(3)
ROOT = np.diag(ROBOT)


def info_of(points: np.ndarray, normals: np.ndarray, sigma: float = 1e-3) -> np.ndarray:
    """(6, 6) of point-to-plane measurements about the cell's origin."""
    J = np.concatenate([normals, np.cross(points, normals)], axis=1) / sigma
    return J.T @ J


def plane(normal: np.ndarray, centre: np.ndarray = ORIGIN) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(0)
    across = np.linalg.svd(normal[None])[2][1:]
    return centre + rng.uniform(-0.3, 0.3, (400, 2)) @ across, np.tile(normal, (400, 1))


def test_a_plane_slides_along_two_axes_and_turns_about_its_normal() -> None:
    seen = observe(info_of(*plane(np.array([1.0, 0, 0]))), ROOT, EYE, ORIGIN, lever=0.3, ratio=0.5)
    assert seen.rank == 3
    assert [n.split(" (")[0] for n in seen.names] == ["slides along cell y", "slides along cell z", "turns about cell x"]
    assert seen.names[0] == "slides along cell y (data nothing, robot ±50 mm)"
    assert seen.names[2] == "turns about cell x (data nothing, robot ±2°)"


def test_a_cylinder_turns_about_its_own_axis_wherever_that_is() -> None:
    angle = np.linspace(0, 2 * np.pi, 300, endpoint=False)
    normals = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    points = np.array([0.4, 0.1, 0.0]) + 0.1 * normals + np.random.default_rng(1).uniform(-0.2, 0.2, (300, 1)) * [0, 0, 1]
    seen = observe(info_of(points, normals), ROOT, EYE, ORIGIN, lever=0.3, ratio=0.5)
    assert seen.rank == 4
    assert [n.split(" (data")[0] for n in seen.names] == ["slides along cell z", "turns about cell z through (0.40, 0.10, 0.00) m"]


def test_three_planes_leave_nothing_open() -> None:
    parts = [plane(n) for n in np.eye(3)]
    info = info_of(np.concatenate([p for p, _ in parts]), np.concatenate([n for _, n in parts]))
    seen = observe(info, ROOT, EYE, ORIGIN, lever=0.3, ratio=0.5)
    assert seen.rank == 6
    assert seen.null.shape == (0, 6)


def test_weak_data_count_as_open_when_the_robot_is_nearly_as_sure() -> None:
    one = np.diag([1.0 / 0.03**2, 1e8, 1e8, 1e8, 1e8, 1e8])
    seen = observe(one, ROOT, EYE, ORIGIN, lever=0.3, ratio=0.5)
    assert seen.names == ("slides along cell x (data ±30 mm, robot ±50 mm)",)
    surer = np.diag([1.0 / 0.02**2, 1e8, 1e8, 1e8, 1e8, 1e8])
    assert observe(surer, ROOT, EYE, ORIGIN, lever=0.3, ratio=0.5).rank == 6


@given(st.integers(0, 2**32 - 1))
def test_the_frame_in_which_the_prior_is_given_does_not_change_what_is_open(seed: int) -> None:
    rng = np.random.default_rng(seed)
    frame = se3.exp(np.concatenate([rng.normal(size=3), rng.normal(size=3)]))
    to_frame = se3.adjoint(frame)
    info = to_frame.T @ info_of(*plane(np.array([1.0, 0, 0]))) @ to_frame
    seen = observe(info, np.eye(6), frame, ORIGIN, lever=0.3, ratio=0.5)
    assert [n.split(" (")[0] for n in seen.names] == ["slides along cell y", "slides along cell z", "turns about cell x"]


def test_open_directions_may_be_asked_for_at_another_point() -> None:
    seen = observe(info_of(*plane(np.array([1.0, 0, 0]))), ROOT, EYE, ORIGIN, lever=0.3, ratio=0.5)
    there = seen.at(np.array([0.8, 0.3, 0.2]))
    np.testing.assert_allclose(there @ there.T, np.eye(3), atol=1e-12)
    v, w = there[:, :3], there[:, 3:] / 0.3
    back = np.concatenate([v - np.cross(w, [0.8, 0.3, 0.2]), w], axis=1)
    assert np.abs(back @ info_of(*plane(np.array([1.0, 0, 0]))) @ back.T).max() < 1e-6


def test_posterior_and_prior_give_back_the_datas_own_information() -> None:
    info = info_of(*plane(np.array([1.0, 0, 0])))
    prior = ROOT @ ROOT
    seen = observe_block(np.linalg.inv(info + np.linalg.inv(prior)), prior, EYE, ORIGIN, VerdictConfig())
    assert seen.rank == 3
    direct = observe(info, ROOT, EYE, ORIGIN, lever=0.3, ratio=0.5)
    np.testing.assert_allclose(seen.data_std[:3], direct.data_std[:3], rtol=1e-3)


def test_pinning_undoes_what_was_moved_along_open_directions_and_nothing_else() -> None:
    seen = observe(info_of(*plane(np.array([1.0, 0, 0]))), ROOT, EYE, ORIGIN, lever=0.3, ratio=0.5)
    moved = se3.exp([0.01, 0.02, 0.03, 0.004, 0.0, 0.0])
    H, b = pinned(seen, moved, moved)
    step = np.linalg.lstsq(H, b, rcond=1e-9)[0]
    final = moved @ se3.exp(step)
    assert np.abs(final[1:3, 3]).max() < 1e-4
    assert np.abs(se3.so3_log(final[:3, :3])[0]) < 1e-4
    assert final[0, 3] == pytest.approx(0.01, abs=1e-3)


def test_the_direction_is_found_of_which_least_agrees() -> None:
    wall, side = plane(np.array([1.0, 0, 0])), plane(np.array([0.0, 1.0, 0]))
    sides, floor = info_of(*side), info_of(*plane(np.array([0.0, 0, 1.0])))
    everyone = info_of(*wall) + sides + floor
    prior = np.linalg.inv(ROOT @ ROOT)
    seen = observe(everyone, ROOT, EYE, ORIGIN, lever=0.3, ratio=0.5)
    share, name = most_disputed(seen, EYE, everyone - 0.8 * sides, everyone, prior)
    assert share == pytest.approx(0.2, abs=0.01)
    assert name == "slides along cell y"
    assert most_disputed(seen, EYE, everyone, everyone, prior)[0] == pytest.approx(1.0)


def test_what_the_data_leave_open_is_not_disputed() -> None:
    wall, prior = info_of(*plane(np.array([1.0, 0, 0]))), np.linalg.inv(ROOT @ ROOT)
    seen = observe(wall, ROOT, EYE, ORIGIN, lever=0.3, ratio=0.5)
    slide = np.diag([0.0, 1e8, 0.0, 0.0, 0.0, 0.0])
    assert most_disputed(seen, EYE, wall, wall + slide, prior)[0] == pytest.approx(1.0)
    assert most_disputed(seen, EYE, 0.0 * wall, wall, prior)[0] < 0.01
    nothing = observe(0.0 * wall, ROOT, EYE, ORIGIN, lever=0.3, ratio=0.5)
    assert most_disputed(nothing, EYE, 0.0 * wall, wall, prior) == (1.0, "")


@pytest.mark.parametrize(
    ("direction", "words"),
    [
        ([1, 0, 0, 0, 0, 0], "slides along cell x"),
        ([0, -1, 0, 0, 0, 0], "slides along cell y"),
        ([0, 0.1, 0.99, 0, 0, 0.04], "slides along cell z"),
        ([0, 0.2, 0.98, 0, 0, 0], "slides along cell (0.00, 0.20, 0.98)"),
        ([0, 0.6, -0.8, 0, 0, 0], "slides along cell (-0.00, -0.60, 0.80)"),
        ([0, 0, 0, 0, 0, -1], "turns about cell z"),
        ([0, 0.04, 0, 0, 0, 1], "turns about cell z"),
        ([0.6, 0, 0, 0, 0, 0.8], "turns about cell z through (1.00, 2.22, 3.00) m"),
        ([0, 0, 0.1, 0, 0.3, 0], "turns about cell y through (1.10, 2.00, 3.00) m"),
        ([0, 0, 0.3, 0, 0, 1], "slides along and turns about cell z"),
        ([0, 0, -0.3, 0, 0, 1], "slides along and turns about cell z"),
        ([0, 0, 0.15, 0, 0, 1], "turns about cell z"),
    ],
)
def test_a_direction_in_words(direction: list[float], words: str) -> None:
    """Turns are in metres at a lever of 0.3 m, about a centre at (1, 2, 3) m."""
    assert describe(np.array(direction, float), np.array([1.0, 2.0, 3.0]), 0.3) == words


def corner() -> tuple[np.ndarray, np.ndarray]:
    """Points on three faces away from the origin, and their normals."""
    parts = [plane(n, np.array([0.8, 0.3, 0.5]) + 0.2 * n) for n in np.eye(3)]
    return np.concatenate([p for p, _ in parts]), np.concatenate([n for _, n in parts])


def test_what_the_data_know_is_counted_about_the_centre_with_turns_at_the_lever() -> None:
    points, normals = corner()
    frame, centre = se3.exp([0.4, -0.2, 0.9, 0.3, 1.0, -0.5]), np.array([0.7, 0.4, 0.6])
    to_frame = se3.adjoint(frame)
    seen = observe(to_frame.T @ info_of(points, normals) @ to_frame, 1e-6 * np.eye(6), frame, centre, lever=0.2, ratio=1e9)
    J = np.concatenate([normals, np.cross(points - centre, normals) / 0.2], axis=1) / 1e-3
    np.testing.assert_allclose(seen.data_std, np.sort(1 / np.sqrt(np.linalg.eigvalsh(J.T @ J))), rtol=1e-6)
    assert (seen.rank, seen.lever) == (6, 0.2)
    assert seen.at(centre).shape == (0, 6)


@pytest.mark.parametrize(
    ("axis", "data", "words"),
    [
        (0, 0.04, "slides along cell x (data ±40 mm, robot ±50 mm)"),
        (1, 9.9, "slides along cell y (data ±9.9e+03 mm, robot ±50 mm)"),
        (2, 10.1, "slides along cell z (data nothing, robot ±50 mm)"),
        (3, np.radians(1.5), "turns about cell x (data ±1.5°, robot ±2°)"),
        (4, np.radians(179.0), "turns about cell y (data ±1.8e+02°, robot ±2°)"),
        (5, np.radians(181.0), "turns about cell z (data nothing, robot ±2°)"),
    ],
)
def test_deviations_are_said_in_millimetres_and_degrees(axis: int, data: float, words: str) -> None:
    info = np.full(6, 1e10)
    info[axis] = data**-2
    assert observe(np.diag(info), ROOT, EYE, ORIGIN, lever=0.3, ratio=0.5).names == (words,)


def test_the_deviation_along_a_direction_is_that_of_the_gaussian() -> None:
    turn = se3.so3_exp([0.3, -0.2, 0.9])
    std = np.array([1.0, 2.0, 5.0])
    direction = np.array([0.6, 0.0, 0.8])
    cov = turn @ np.diag(std**2) @ turn.T
    assert spread(direction, turn, std) == pytest.approx(np.sqrt(direction @ cov @ direction))


def test_pinning_holds_the_place_of_the_centre() -> None:
    """A wall away from the origin: its middle may slide and turn about its normal, and is put back there."""
    centre = np.array([0.5, 0.7, -0.4])
    seen = observe(info_of(*plane(np.array([1.0, 0, 0]), centre)), ROOT, EYE, centre, lever=0.3, ratio=0.5)
    motion = se3.exp([0.001, 0.002, 0.003, 0.004, 0.0005, 0.0])
    H, b = pinned(seen, motion, motion)
    final = motion @ se3.exp(np.linalg.lstsq(H, b, rcond=1e-9)[0])
    left = se3.apply(final, centre) - centre
    assert np.abs(left[1:]).max() < 3e-5
    assert abs(se3.so3_log(final[:3, :3])[0]) < 1e-5
    assert np.linalg.norm(H) > 1e11
    whole = observe(1e9 * np.eye(6), ROOT, EYE, centre, lever=0.3, ratio=0.5)
    np.testing.assert_array_equal(pinned(whole, motion, motion)[0], np.zeros((6, 6)))
    np.testing.assert_array_equal(pinned(whole, motion, motion)[1], np.zeros(6))


def test_mixed_open_directions_are_told_as_slides_and_turns_along_the_axes() -> None:
    """Whatever basis the eigenvectors have: slides first, then turns, each along an axis of the cell."""
    rng = np.random.default_rng(6)
    mix = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    tidy = _tidy(mix @ np.eye(6)[[0, 2, 4]])
    np.testing.assert_allclose(np.abs(tidy), np.eye(6)[[0, 2, 4]], atol=1e-9)
    np.testing.assert_allclose(np.abs(_tidy(mix @ np.eye(6)[[3, 4, 5]])), np.eye(6)[[3, 4, 5]], atol=1e-9)
    assert _tidy(np.zeros((0, 6))).shape == (0, 6)


def test_a_turn_about_one_point_is_a_turn_and_a_slide_at_another() -> None:
    turn = Observability(np.eye(6)[5:], ("turns about cell z",), np.ones(6), np.array([0.5, 0.0, 0.0]), 0.3)
    there = turn.at(np.array([1.5, 0.0, 0.0]))[0]
    expected = np.array([0.0, 1.0, 0.0, 0.0, 0.0, 0.3]) / np.hypot(1.0, 0.3)
    np.testing.assert_allclose(there * np.sign(there[5]), expected, atol=1e-12)
