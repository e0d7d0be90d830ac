# SPDX-License-Identifier: Apache-2.0
"""Verdicts: each reason to refuse, and the figures they stand on."""

from __future__ import annotations

import numpy as np
import pytest

from tests.tof_align.made import CONFIG, ROBOT, one_view, section
from tests.tof_align.pixel_rows import view_of
from tof_align.linearise import linearise
from tof_align.pixels import take_pixels
from tof_align.verdict import Fit, disagreeing, fit_of, information_of, judge
from tof_core import se3

GOOD, BAD = Fit(1000, 0.95, 1e-3, 1e-3), Fit(1000, 0.2, 5e-3, 12e-3)
EYE, COV = np.eye(4), np.diag(ROBOT**2)


def test_support_is_the_share_of_pixels_on_the_cad_that_agree() -> None:
    view, truth = one_view(section(), np.zeros(6))
    lin = linearise(take_pixels(view, CONFIG.weights), truth.T_cell_camera, section(), CONFIG.weights)
    offset = np.zeros(len(lin.residual))
    offset[: len(offset) // 4] = -0.02
    fit = fit_of(lin, CONFIG, offset)
    assert fit.pixels == len(lin.residual)
    assert fit.support == pytest.approx(0.75, abs=0.001)
    assert fit.rms == pytest.approx(float(np.sqrt((lin.residual[len(offset) // 4 :] ** 2).mean())), rel=1e-6)
    assert fit.score == pytest.approx(0.25 * 0.015 + 0.75 * float(np.abs(lin.residual[len(offset) // 4 :]).mean()), rel=0.01)


def test_what_is_explained_away_by_more_than_twice_the_limit_does_not_agree() -> None:
    view, truth = one_view(section(), np.zeros(6), effect=lambda seen: 0.04 + 0 * seen.depth)
    lin = linearise(take_pixels(view, CONFIG.weights), truth.T_cell_camera, section(), CONFIG.weights)
    assert fit_of(lin, CONFIG, 0.04).support == 0.0


def test_no_pixels_no_support() -> None:
    view, truth = one_view(section(), np.zeros(6))
    view.depth[:] = np.nan
    lin = linearise(take_pixels(view, CONFIG.weights), truth.T_cell_camera, section(), CONFIG.weights)
    assert fit_of(lin, CONFIG) == fit_of(lin, CONFIG, 0.0) or np.isnan(fit_of(lin, CONFIG).rms)
    assert fit_of(lin, CONFIG).support == 0.0


def test_a_good_fit_within_the_robots_error_is_accepted() -> None:
    T = se3.exp([0.04, 0, 0.03, 0, 0.02, 0])
    verdict = judge(BAD, GOOD, EYE, T, COV, (), CONFIG)
    assert verdict.accepted
    assert (verdict.short, verdict.reason) == ("ok", "ok")
    assert verdict.step_mm == pytest.approx(50.0, rel=0.02)
    assert verdict.step == pytest.approx(np.sqrt((0.8**2 + 0.6**2 + np.degrees(0.02) ** 2 / 4) / 6), rel=0.02)


@pytest.mark.parametrize(
    ("fit", "T", "short", "reason"),
    [
        (Fit(50, 1.0, 1e-3, 1e-3), EYE, "too few pixels on the CAD", "only 50 pixels see the CAD"),
        (BAD, EYE, "fits nowhere", "fits nowhere: 20 % of 1000 pixels within 15 mm"),
        (
            GOOD,
            se3.exp([0.7, 0, 0, 0, 0, 0]),
            "too far from the robot's pose",
            "700 mm and 0.0° from the robot's pose, 5.7 times what its error allows",
        ),
        (Fit(1000, 0.6, 2e-3, 7e-3), EYE, "no better than the robot's pose", "no better than the robot's pose"),
    ],
)
def test_each_reason_to_refuse(fit: Fit, T: np.ndarray, short: str, reason: str) -> None:
    verdict = judge(GOOD, fit, EYE, T, COV, (), CONFIG)
    assert not verdict.accepted
    assert verdict.short == short
    assert verdict.reason.startswith(reason)


def test_a_direction_that_most_of_its_pixels_dispute_is_refused_and_named() -> None:
    verdict = judge(GOOD, GOOD, EYE, EYE, COV, (), CONFIG, (0.3, "slides along cell y"))
    assert not verdict.accepted
    assert verdict.short == "contradicted"
    assert verdict.reason.startswith("of the pixels that determine how it slides along cell y, 30 % agree with the CAD")
    assert judge(GOOD, GOOD, EYE, EYE, COV, (), CONFIG, (0.6, "slides along cell y")).accepted


def test_a_witness_counts_what_agrees_and_what_would() -> None:
    view, truth = one_view(section(), np.zeros(6))
    lin = linearise(take_pixels(view, CONFIG.weights), truth.T_cell_camera, section(), CONFIG.weights)
    weight = 0.1 / lin.sigma**2
    J = lin.jacobian * np.sqrt(weight)[:, None]
    whole = information_of(lin, weight, CONFIG)
    np.testing.assert_allclose(whole.everyone, J.T @ J, rtol=1e-9)
    np.testing.assert_allclose(whole.agreeing, whole.everyone, rtol=1e-9)
    off = np.where(np.arange(len(lin.residual)) % 2 > 0, 0.02, 0.0)
    half = information_of(lin, np.where(off > 0, 0.0, weight), CONFIG, off)
    np.testing.assert_allclose(half.everyone, whole.everyone, rtol=1e-9)
    np.testing.assert_allclose(half.agreeing, J[::2].T @ J[::2], rtol=1e-9)
    twice = (half + half).moved(2.0 * np.eye(6))
    np.testing.assert_allclose(twice.agreeing, 8.0 * half.agreeing)


def test_open_directions_are_said_in_an_accepted_verdict() -> None:
    verdict = judge(GOOD, GOOD, EYE, EYE, COV, ("slides along cell y",), CONFIG)
    assert verdict.accepted
    assert verdict.short == "the robot's pose in part"
    assert verdict.reason == "robot's pose kept where the data do not say: slides along cell y"


def test_pixels_that_agree_are_within_the_limit_on_either_side() -> None:
    fit = fit_of(view_of([0.0149, -0.0149, 0.0151, -0.0151, 0.5, 0.003, 0.0, 0.0]), CONFIG)
    assert (fit.pixels, fit.support) == (8, 5 / 8)
    assert fit.rms == pytest.approx(np.sqrt((2 * 0.0149**2 + 0.003**2) / 5))
    assert fit.score == pytest.approx((2 * 0.0149 + 3 * 0.015 + 0.003) / 8)


def test_where_nothing_agrees_or_nothing_is_seen() -> None:
    none, far = fit_of(view_of([]), CONFIG), fit_of(view_of([0.02, -0.5]), CONFIG)
    assert (none.pixels, none.support, none.score) == (0, 0.0, 0.015)
    assert (far.pixels, far.support, far.score) == (2, 0.0, 0.015)
    assert np.isnan(none.rms)
    assert np.isnan(far.rms)


@pytest.mark.parametrize(("offset_mm", "support"), [(29.9, 1.0), (-29.9, 1.0), (30.1, 0.0), (-30.1, 0.0)])
def test_a_discrepancy_of_twice_the_limit_vouches_for_nothing(offset_mm: float, support: float) -> None:
    offset = np.full(5, 1e-3 * offset_mm)
    assert fit_of(view_of(offset), CONFIG, offset).support == support


@pytest.mark.parametrize(
    ("seed", "fit", "accepted"),
    [
        (GOOD, Fit(200, 0.5, 1e-3, 1e-3), True),
        (GOOD, Fit(199, 0.95, 1e-3, 1e-3), False),
        (GOOD, Fit(1000, 0.499, 1e-3, 1e-3), False),
        (Fit(1000, 0.9, 1e-3, 2e-3), Fit(1000, 0.82, 1e-3, 2.1e-3), True),
        (Fit(1000, 0.9, 1e-3, 2e-3), Fit(1000, 0.80, 1e-3, 2.1e-3), False),
        (Fit(1000, 0.9, 1e-3, 2e-3), Fit(800, 0.90, 1e-3, 2.1e-3), False),
        (Fit(1000, 0.9, 1e-3, 2e-3), Fit(1000, 0.80, 1e-3, 2e-3), True),
    ],
)
def test_bounds_are_met_by_what_equals_them(seed: Fit, fit: Fit, *, accepted: bool) -> None:
    """The last three: fewer agree than nine tenths of those at the robot's pose, and a score that is worse."""
    if fit.support == 0.5:
        seed = Fit(200, 0.5, 1e-3, 1e-3)
    assert judge(seed, fit, EYE, EYE, COV, (), CONFIG).accepted is accepted


@pytest.mark.parametrize(("factor", "accepted"), [(0.999, True), (1.001, False)])
def test_a_step_of_four_standard_deviations_is_the_largest(factor: float, *, accepted: bool) -> None:
    far = se3.exp(factor * 4.0 * ROBOT * [1, -1, 1, -1, 1, -1])
    verdict = judge(BAD, GOOD, EYE, far, COV, (), CONFIG)
    assert verdict.accepted is accepted
    assert verdict.step == pytest.approx(factor * 4.0)
    assert verdict.step_deg == pytest.approx(factor * 8.0 * np.sqrt(3), rel=1e-6)
    assert verdict.step_mm == pytest.approx(1e3 * np.linalg.norm(far[:3, 3]))
    assert judge(BAD, GOOD, EYE, far, None, (), CONFIG).accepted, "nothing is known of the robot's error"
    assert judge(BAD, GOOD, EYE, far, None, (), CONFIG).step == 0.0


def test_the_step_is_counted_in_the_frame_of_the_robots_pose() -> None:
    T = se3.exp([0.3, -0.2, 0.5, 0.4, 0.9, -0.3])
    small = np.array([0.02, -0.01, 0.03, 0.01, 0.0, -0.02])
    cov = COV + 1e-4 * np.ones((6, 6))
    verdict = judge(BAD, GOOD, T, T @ se3.exp(small), cov, (), CONFIG)
    assert verdict.step == pytest.approx(np.sqrt(small @ np.linalg.inv(cov) @ small / 6))


@pytest.mark.parametrize(("share", "accepted"), [(0.5, True), (0.499, False)])
def test_half_of_what_knows_a_direction_must_agree(share: float, *, accepted: bool) -> None:
    assert judge(GOOD, GOOD, EYE, EYE, COV, (), CONFIG, (share, "slides along cell y")).accepted is accepted


def test_the_first_reason_is_said() -> None:
    far = se3.exp([0.7, 0, 0, 0, 0, 0])
    said = [
        judge(GOOD, Fit(50, 0.1, 1e-3, 0.014), EYE, far, COV, (), CONFIG, (0.1, "slides")).reason,
        judge(GOOD, Fit(500, 0.1, 1e-3, 0.014), EYE, far, COV, (), CONFIG, (0.1, "slides")).reason,
        judge(GOOD, Fit(500, 0.6, 1e-3, 0.014), EYE, far, COV, (), CONFIG, (0.1, "slides")).reason,
        judge(GOOD, Fit(500, 0.6, 1e-3, 0.014), EYE, far, COV, (), CONFIG).reason,
        judge(GOOD, Fit(500, 0.6, 1e-3, 0.014), EYE, EYE, COV, (), CONFIG).reason,
    ]
    begins = ("only 50 pixels", "fits nowhere: 10 %", "of the pixels that determine how it slides, 10 %", "700 mm", "no better")
    assert all(reason.startswith(begin) for reason, begin in zip(said, begins, strict=True))
    assert said[4].endswith("(60 % against 95 % agree)")


def test_parts_that_disagree_are_said_beside_what_is_open() -> None:
    both = judge(GOOD, GOOD, EYE, EYE, COV, ("a", "b"), CONFIG, apart="parts disagree with the CAD: lid by 5 mm")
    assert both.reason == "robot's pose kept where the data do not say: a; b; parts disagree with the CAD: lid by 5 mm"
    assert judge(GOOD, GOOD, EYE, EYE, COV, (), CONFIG, apart="x").reason == "x"
    assert (both.seed, both.fit, both.null) == (GOOD, GOOD, ("a", "b"))


def test_where_no_pixel_agrees_all_count_by_their_noise() -> None:
    view = view_of([0.5, -0.5, 0.4], sigma=[1e-3, 2e-3, 4e-3])
    found = information_of(view, np.ones(3), CONFIG)
    np.testing.assert_array_equal(found.agreeing, np.zeros((6, 6)))
    np.testing.assert_allclose(found.everyone, (view.jacobian / view.sigma[:, None] ** 2).T @ view.jacobian)


@pytest.mark.parametrize(
    ("apart_mm", "std_mm", "named"), [(2.1, 0.1, True), (1.9, 0.1, False), (6.1, 2.0, True), (5.9, 2.0, False), (0.0, 0.0, False)]
)
def test_a_part_is_named_from_two_millimetres_and_three_deviations_on(apart_mm: float, std_mm: float, *, named: bool) -> None:
    found = disagreeing(np.array([1e-3 * apart_mm]), np.array([1e-3 * std_mm]), CONFIG.verdict)
    assert found[0] == (1e-3 * apart_mm if named else 0.0)
