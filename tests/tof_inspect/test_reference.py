# SPDX-License-Identifier: Apache-2.0
"""A reference session removes what it shows of the errors that repeat, adds no noise of its own, and sigma says what stays."""

from __future__ import annotations

import numpy as np
import pytest

from tof_inspect.config import InspectConfig
from tof_inspect.displaced import Fit
from tof_inspect.reference import ReferenceSession, Standing, least_scale, relative

NEW_MM, SHARED_MM = 0.3, 0.4
CONFIG = InspectConfig()


def fit(shift_mm: tuple[float, float, float], new_mm: float = NEW_MM, shared_mm: float = SHARED_MM, axes: int = 3) -> Fit:
    """A part whose place is known along the first `axes` axes of the cell."""
    known = np.eye(3)[:, :axes]
    noise, unknown = 1e-6 * new_mm**2 * np.eye(3), np.diag([1.0 * (k >= axes) for k in range(3)])
    return Fit(
        known @ known.T @ (1e-3 * np.array(shift_mm)), noise, np.zeros((3, 3)), 1e-6 * shared_mm**2 * np.eye(3) + unknown, known, 0.0
    )


def test_the_difference_errs_less_than_either_session_and_as_sigma_says() -> None:
    rng = np.random.default_rng(0)
    alone, beside, whole, sigmas = [], [], [], []
    for _ in range(3000):
        camera, new, old = rng.normal(0, SHARED_MM, 3), rng.normal(0, NEW_MM, 3), rng.normal(0, NEW_MM, 3)
        now, then = fit(tuple(camera + new)), fit(tuple(camera + old))
        found = relative(now, then, CONFIG)
        alone.append(camera + new)
        whole.append(new - old)
        beside.append(1e3 * found.shift)
        sigmas.append(1e3 * found.shift / (1e3 * np.sqrt(np.diag(found.cov))))
    assert np.std(beside) < 0.95 * np.std(whole)
    assert np.std(beside) < 0.8 * np.std(alone)
    assert np.std(beside) == pytest.approx(np.sqrt(NEW_MM**2 + 1 / (SHARED_MM**-2 + NEW_MM**-2)), rel=0.03), "least variance"
    assert np.mean(np.abs(sigmas) < 2) == pytest.approx(0.954, abs=0.012)


def test_a_reference_of_mere_noise_changes_nothing() -> None:
    now = fit((5.0, 0.0, 0.0))
    found = relative(now, fit((0.4, -0.3, 0.2), new_mm=5.0), CONFIG)
    np.testing.assert_allclose(found.shift, now.shift, atol=1e-5)
    assert found.std_mm == pytest.approx(now.std_mm, rel=0.01)


def test_an_error_beyond_all_that_is_stated_is_removed_as_a_whole() -> None:
    found = relative(fit((0.0, 9.0, 0.0)), fit((0.0, 6.0, 0.0)), CONFIG)
    assert found.mm == pytest.approx(3.0, abs=0.15)
    assert least_scale(fit((0.0, 6.0, 0.0))) == pytest.approx((36.0 / 7.81 - NEW_MM**2) / SHARED_MM**2, rel=0.06), (
        "chi-square of 3: 5 % beyond 7.81"
    )
    assert least_scale(fit((0.3, 0.3, 0.3))) == 1.0


def test_an_axis_that_the_reference_does_not_know_is_as_before() -> None:
    now = fit((0.5, 0.4, 3.0))
    found = relative(now, fit((0.5, 0.4, 0.0), axes=2), CONFIG)
    assert found.shift[2] == pytest.approx(now.shift[2])
    assert found.cov[2, 2] == pytest.approx(now.cov[2, 2])
    assert found.shift[0] < 0.25e-3
    assert found.cov[0, 0] < now.cov[0, 0]


def test_only_cameras_from_about_the_same_places_are_compared() -> None:
    then = ReferenceSession({"clip": Standing(fit((6.0, 0.0, 0.0)), np.zeros((1, 3)))})
    now = fit((6.0, 0.0, 0.0))
    near, far = (then.relative("clip", now, [np.array([x, 0.0, 0.0])], CONFIG) for x in (0.1, 0.2))
    assert near.mm < 0.3
    assert far is now
    assert then.relative("other", now, [np.zeros(3)], CONFIG) is now
