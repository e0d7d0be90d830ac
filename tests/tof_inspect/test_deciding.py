# SPDX-License-Identifier: Apache-2.0
"""What decides a verdict: bounds of `decide`, the probability's formula, and what an uncertain pose adds to a pixel's sigma."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.tof_inspect.made import SURE, plate, seen
from tof_core import se3
from tof_inspect.config import InspectConfig
from tof_inspect.displaced import Fit
from tof_inspect.evidence import agreement, see
from tof_inspect.judge import decide, probability
from tof_scene.raycast import Raycaster

CONFIG = InspectConfig(prior=0.5)
PART = replace(plate().part("block"), tolerance_mm=2.0)


def fitted(mm: float, std: float, ratio: float = 0.0) -> Fit:
    """A part displaced along x, its place known by `std` along each axis."""
    none, shared = np.zeros((3, 3)), np.eye(3) * (1e-3 * std) ** 2
    return Fit(np.array([1e-3 * mm, 0.0, 0.0]), none, none, shared, np.eye(3), ratio)


STAYS = fitted(0.0, 1.0)


def log_odds(p: float) -> float:
    return float(np.log(p / (1.0 - p)))


def state(depth: float, fit: Fit = STAYS, colour: float = 0.0) -> str:
    return decide(PART, [], depth, colour, fit, CONFIG).state


@pytest.mark.parametrize(
    ("prior", "ratio", "p"), [(0.5, 0.0, 0.5), (0.5, log_odds(0.9), 0.9), (0.98, 0.0, 0.98), (0.98, -log_odds(0.98), 0.5)]
)
def test_the_probability_is_bayes(prior: float, ratio: float, p: float) -> None:
    assert probability(ratio, InspectConfig(prior=prior)) == pytest.approx(p)


def test_a_verdict_takes_the_probability_that_is_asked_of_it() -> None:
    edge = log_odds(CONFIG.decide)
    for depth, expected in (
        (edge + 0.01, "present"),
        (edge - 0.01, "not_observable"),
        (-edge + 0.01, "not_observable"),
        (-edge - 0.01, "absent"),
    ):
        assert state(depth) == expected
    assert state(0.6 * edge, colour=0.6 * edge) == "present", "depth and colour together"
    assert state(1.2 * edge, colour=-edge) == "not_observable"


def test_displaced_is_beyond_tolerance_and_beyond_its_own_sigmas() -> None:
    for mm, std, expected in (
        (2.0, 0.1, "present"),
        (4.9, 1.0, "present"),
        (5.1, 1.0, "displaced"),
        (2.4, 0.1, "displaced"),
        (2.2, 0.1, "present"),
    ):
        assert state(50.0, fitted(mm, std)) == expected, (mm, std)


def test_a_part_at_another_place_is_there_where_that_explains_enough() -> None:
    needed = CONFIG.cell_px * (CONFIG.moved_cost + log_odds(CONFIG.decide))
    for ratio, expected in (
        (1.01 * needed, "displaced"),
        (0.9 * CONFIG.cell_px * CONFIG.moved_cost - 6 * log_odds(CONFIG.decide), "absent"),
    ):
        assert state(-50.0, fitted(8.0, 0.5, ratio)) == expected


@pytest.mark.parametrize("axis", range(3))
def test_a_pose_that_is_unsure_by_millimetres_widens_along_the_ray_and_by_the_slope(axis: int) -> None:
    caster, view = Raycaster(plate()), seen(plate())
    cov = np.zeros((6, 6))
    cov[axis, axis] = 4e-3**2
    sure, unsure = (
        see(view, replace(SURE, cov=se3.cov_fixed_axes(SURE.T_cell_camera, c)), caster, CONFIG) for c in (np.zeros((6, 6)), cov)
    )
    added = np.sqrt(np.maximum(unsure.sigma**2 - sure.sigma**2, 0.0))
    rays, slope = view.camera.rays(), np.tan(np.minimum(unsure.whole.incidence, np.radians(85.0)))
    share = np.abs(rays[..., axis]) / view.camera.ray_length()
    known = np.isfinite(unsure.whole.depth) & np.isfinite(sure.sigma)
    np.testing.assert_allclose(added[known], (4e-3 * np.hypot(share, slope))[known], rtol=1e-3, atol=1e-6)


def test_a_pose_that_is_unsure_in_turn_widens_far_and_slanted_pixels() -> None:
    caster, view = Raycaster(plate()), seen(plate())
    cov = np.diag([0, 0, 0, 1e-3, 0, 0]) ** 2
    sure, unsure = (
        see(view, replace(SURE, cov=se3.cov_fixed_axes(SURE.T_cell_camera, c)), caster, CONFIG) for c in (np.zeros((6, 6)), cov)
    )
    slope = np.tan(np.minimum(unsure.whole.incidence, np.radians(85.0)))
    known = np.isfinite(unsure.whole.depth) & np.isfinite(sure.sigma)
    added = np.sqrt(np.maximum(unsure.sigma**2 - sure.sigma**2, 0.0))
    np.testing.assert_allclose(added[known], (1e-3 * unsure.whole.depth * slope)[known], rtol=1e-3, atol=1e-6)


def test_agreement_is_the_share_within_a_centimetre_or_four_sigmas() -> None:
    made = see(seen(plate()), SURE, Raycaster(plate()), CONFIG)
    clear = np.isfinite(made.whole.depth) & (made.whole.mixed < 0.02) & (made.whole.incidence < np.radians(75.0))
    assert clear.sum() > 1000
    for error, noise, share in ((0.0099, 1e-3, 1.0), (0.0101, 1e-3, 0.0), (0.0199, 5e-3, 1.0), (0.0201, 5e-3, 0.0)):
        off = replace(made.view, depth=(made.whole.depth.astype(float) + error))  # type: ignore[arg-type]
        assert agreement(replace(made, view=off, noise=np.full(clear.shape, noise))) == share
