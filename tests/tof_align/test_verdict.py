# SPDX-License-Identifier: Apache-2.0
"""Verdicts: each reason to refuse, and the figures they stand on."""

from __future__ import annotations

import numpy as np
import pytest

from tests.tof_align.made import CONFIG, ROBOT, one_view, section
from tof_align.linearise import linearise
from tof_align.pixels import take_pixels
from tof_align.verdict import Fit, fit_of, information_of, judge
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
    assert verdict.reason == "ok"
    assert verdict.step_mm == pytest.approx(50.0, rel=0.02)
    assert verdict.step == pytest.approx(np.sqrt((0.8**2 + 0.6**2 + np.degrees(0.02) ** 2 / 4) / 6), rel=0.02)


@pytest.mark.parametrize(
    ("fit", "T", "reason"),
    [
        (Fit(50, 1.0, 1e-3, 1e-3), EYE, "only 50 pixels see the CAD"),
        (BAD, EYE, "fits nowhere: 20 % of 1000 pixels within 15 mm"),
        (GOOD, se3.exp([0.7, 0, 0, 0, 0, 0]), "700 mm and 0.0° from the robot's pose, 5.7 times what its error allows"),
        (Fit(1000, 0.6, 2e-3, 7e-3), EYE, "no better than the robot's pose"),
    ],
)
def test_each_reason_to_refuse(fit: Fit, T: np.ndarray, reason: str) -> None:
    verdict = judge(GOOD, fit, EYE, T, COV, (), CONFIG)
    assert not verdict.accepted
    assert verdict.reason.startswith(reason)


def test_a_direction_that_most_of_its_pixels_dispute_is_refused_and_named() -> None:
    verdict = judge(GOOD, GOOD, EYE, EYE, COV, (), CONFIG, (0.3, "slides along cell y"))
    assert not verdict.accepted
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
    assert verdict.reason == "robot's pose kept where the data do not say: slides along cell y"
