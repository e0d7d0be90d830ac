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
from tof_inspect.evidence import Evidence, agreement, see
from tof_inspect.judge import Inspector, PartVerdict, decide, probability
from tof_inspect.place import UNSEEN_TODO, Place
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


def test_a_verdict_needs_the_configured_probability() -> None:
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
    for error, noise, share in ((0.0099, 1e-3, 1.0), (0.0101, 1e-3, 0.0), (0.0199, 5e-3, 1.0), (0.0201, 5e-3, 0.0), (-0.0101, 1e-3, 0.0)):
        off = replace(made.view, depth=(made.whole.depth.astype(float) + error))  # type: ignore[arg-type]
        assert agreement(replace(made, view=off, noise=np.full(clear.shape, noise))) == share


def evidence(*pixels: int, covered: int = 50) -> list[Evidence]:
    """Views with so many distinctive pixels each."""
    none = np.zeros(0)
    return [Evidence(p, covered, 0.0, none.astype(int), none, none, none, none) for p in pixels]


SURE_RATIO, UNSURE = 50.0, Place(False, 4.0, "place known to 4.0 mm only", "look again")


def test_a_verdict_says_by_what_and_how_well() -> None:
    fit = fitted(0.5, 0.1)
    by_depth = decide(PART, evidence(30, 0, 12), SURE_RATIO, 0.0, fit, CONFIG)
    assert (by_depth.state, by_depth.why, by_depth.judged, by_depth.todo) == ("present", "in its place, by depth", True, "")
    assert (by_depth.pixels, by_depth.views, by_depth.tolerance_mm) == (42, 2, 2.0)
    assert (by_depth.log_depth, by_depth.log_colour, by_depth.log_ratio) == (50.0, 0.0, 50.0)
    assert (by_depth.displaced_mm, by_depth.std_mm) == pytest.approx((0.5, 0.1))
    assert by_depth.shift_mm == pytest.approx((0.5, 0.0, 0.0))
    np.testing.assert_allclose(by_depth.cov_mm2, np.eye(3) * 0.01)
    with_colour = decide(PART, evidence(30), SURE_RATIO, 3.0, fit, CONFIG, UNSURE)
    assert (with_colour.why, with_colour.judged, with_colour.todo) == (
        "present by depth and colour, place known to 4.0 mm only",
        False,
        "look again",
    )
    absent = decide(PART, evidence(30), -SURE_RATIO, 0.0, fit, CONFIG, UNSURE)
    assert (absent.state, absent.judged, absent.todo) == ("absent", True, "")
    assert (absent.shift_mm, absent.cov_mm2) == ((), ())
    assert np.isnan(absent.displaced_mm)
    assert np.isnan(absent.std_mm)
    displaced = decide(PART, evidence(30), SURE_RATIO, 0.0, fitted(8.0, 0.5), CONFIG, UNSURE)
    assert (displaced.state, displaced.judged, displaced.todo) == ("displaced", True, "")
    assert displaced.why == "8.0 ± 0.5 mm from the CAD, tolerance 2 mm"


@pytest.mark.parametrize(("place", "todo"), [(UNSURE, "look again"), (Place(True, 0.1), UNSEEN_TODO)])
def test_an_undecided_part_is_not_judged_and_has_something_to_do(place: Place, todo: str) -> None:
    found = decide(PART, evidence(30), 0.0, 0.0, STAYS, CONFIG, place)
    assert (found.state, found.judged, found.todo, found.why) == ("not_observable", False, todo, "undecided: probability 0.50")


@pytest.mark.parametrize(("pixels", "p"), [((30,), 0.5), ((15, 15), 0.5), ((29,), None)])
def test_of_too_few_pixels_no_probability_is_stated(pixels: tuple[int, ...], p: float | None) -> None:
    found = decide(PART, evidence(*pixels), 0.0, 0.0, STAYS, CONFIG)
    assert found.to_dict()["probability"] == p
    assert decide(PART, evidence(*pixels), SURE_RATIO, 0.0, STAYS, CONFIG).probability == pytest.approx(1.0)


def test_at_its_tolerance_a_part_is_in_its_place() -> None:
    assert state(SURE_RATIO, Fit(np.array([2e-3, 0, 0]), *(np.zeros((3, 3)),) * 3, np.eye(3), 0.0)) == "present"


def test_numbers_that_are_not_known_are_null() -> None:
    values = PartVerdict("a", "absent", float("nan"), 3, 1, float("inf"), 0.5, 0.5, float("nan"), 1.0, 2.0, "why").to_dict()
    assert (values["probability"], values["log_depth"], values["displaced_mm"]) == (None, None, None)
    assert (values["name"], values["pixels"], values["log_colour"], values["judged"], values["shift_mm"]) == ("a", 3, 0.5, True, ())


@pytest.mark.parametrize(("share", "agrees"), [(0.941, True), (0.939, False)])
def test_a_view_that_disagrees_with_the_cad_is_left_out(share: float, *, agrees: bool) -> None:
    inspector = Inspector(Raycaster(plate()), CONFIG)
    view = seen(plate())
    made = see(view, SURE, inspector.caster, CONFIG)
    clear = np.flatnonzero(np.isfinite(made.whole.depth) & (made.whole.mixed < 0.02) & (made.whole.incidence < np.radians(75.0)))
    depth = made.whole.depth.copy()
    depth.flat[clear[: round((1 - share) * len(clear))]] += 0.1
    views = [seen(plate()), replace(view, depth=depth), view]
    poses = [SURE, SURE, replace(SURE, accepted=False)]
    assert [s.number for s in inspector._seen(views, poses)] == ([0, 1] if agrees else [0])


def test_a_view_is_useful_from_a_third_of_the_pixels_on() -> None:
    inspector = Inspector(Raycaster(plate()), CONFIG)
    made = see(seen(plate()), SURE, inspector.caster, CONFIG)
    assert len(inspector._useful([made] * 4, evidence(9, 10, 11, 30))) == 3


def test_agreement_leaves_out_edges_grazing_pixels_and_what_is_missing() -> None:
    made = see(seen(plate()), SURE, Raycaster(plate()), CONFIG)
    shape = made.whole.depth.shape
    flat = replace(made.whole, depth=np.ones(shape, np.float32), mixed=np.zeros(shape, np.float32), incidence=np.zeros(shape, np.float32))
    for name, value, counts in (
        ("mixed", 0.019, True),
        ("mixed", 0.021, False),
        ("incidence", np.radians(74.9), True),
        ("incidence", np.radians(75.1), False),
    ):
        image = getattr(flat, name).copy()
        image[:60] = value
        depth = np.ones(shape, np.float32)
        depth[:60] += 0.5
        view = replace(made.view, depth=depth)
        assert agreement(replace(made, view=view, whole=replace(flat, **{name: image}), noise=np.full(shape, 1e-3))) == (
            0.5 if counts else 1.0
        )
    nothing = replace(made.view, depth=np.full(shape, np.nan, np.float32))
    assert agreement(replace(made, view=nothing)) == 0.0
