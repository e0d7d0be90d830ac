# SPDX-License-Identifier: Apache-2.0
"""Sizes that held-out views confirm, on maps of a few pixels; what a calibration covers, at its bounds; how sure a name is."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tof_core.calibration import Calibration
from tof_core.camera import Camera
from tof_gap.solve.causes import confidence, smooth_ones
from tof_gap.solve.confirmed import _one_surface, confirmed, energy_share, mean_square, seen_share, sizes_m
from tof_gap.solve.tolerance import _no_longer, calibrated
from tof_gap.solved import Named
from tof_sensor.effects.depth_scale import DepthScale
from tof_sensor.effects.motion import Motion
from tof_sensor.effects.wiggling import Wiggling

CAMERA = Camera(width=128, height=98, fx=120.0, fy=120.0, cx=63.5, cy=48.5)


def view(residual: Any, smooth: Any = None, *, gross_mm: float = 50.0) -> Any:
    """A view of four pixels, all measured before CAD but the last one."""
    e = np.asarray(residual, float).copy()
    e[-1] = np.nan
    flat = np.isfinite(e) & (True if smooth is None else np.asarray(smooth))
    return SimpleNamespace(residual=e, smooth=flat, limits=SimpleNamespace(gross_mm=gross_mm))


def test_a_map_that_measurements_bear_out_has_its_own_size() -> None:
    """A map of 2 mm that views 1 and 2 show in full, in half, and not at all; view 0 is not held out."""
    maps = {Wiggling.NAME: [np.full(4, 2e-3)] * 3}
    for share, size in ((1.0, 2e-3), (0.75, 2e-3 * np.sqrt(0.5)), (0.5, 0.0), (0.0, 0.0), (1.5, 2e-3 * np.sqrt(2.0))):
        views = [view(np.full(4, 99.0)), *[view(np.full(4, share * 2e-3))] * 2]
        assert sizes_m(maps, views, [1, 2])[Wiggling.NAME] == pytest.approx(size, abs=1e-12)


def test_further_views_confirm_by_maps_that_were_not_fitted_to_them() -> None:
    """View 2 alone is held out, and shows nothing of 2 mm; views 0 and 1 show them in full, by maps of fits to the others."""
    maps = {Wiggling.NAME: [np.full(4, 2e-3)] * 3}
    views = [*[view(np.full(4, 2e-3))] * 2, view(np.full(4, 1e-3))]
    assert sizes_m(maps, views, [2])[Wiggling.NAME] == 0.0
    further = {v: {Wiggling.NAME: np.full(4, 2e-3)} for v in (0, 1)}
    assert sizes_m(maps, views, [2], further)[Wiggling.NAME] == pytest.approx(2e-3 * np.sqrt(2 / 3))
    other = {
        v: {Wiggling.NAME: np.full(4, 1e-3)} for v in (0, 1)
    }  # Fits to the others find half: 4 x (1 + 2) - 2 x 2 - 2 x 2 of 2 x 1 + 4.
    assert sizes_m(maps, views, [2], other)[Wiggling.NAME] == pytest.approx(2e-3 * np.sqrt(1 + 2 * (2 * 1e-6 - 2e-6) / 6e-6))


def test_what_other_maps_explain_is_left_to_them() -> None:
    maps = {Wiggling.NAME: [np.full(4, 2e-3)], DepthScale.NAME: [np.full(4, 1e-3)]}
    both = sizes_m(maps, [view(np.full(4, 3e-3))], [0])
    assert both == pytest.approx({Wiggling.NAME: 2e-3, DepthScale.NAME: 1e-3})


def test_pixels_that_are_not_smooth_do_not_count_but_for_what_smears() -> None:
    """At the second pixel the map is 8 mm: an edge. What smears is as large there as elsewhere, up to what no bias reaches."""
    made, seen = np.array([2e-3, 8e-3, 2e-3, 2e-3]), np.array([2e-3, 8e-3, 2e-3, 2e-3])
    smooth = [True, False, True, True]
    assert sizes_m({Wiggling.NAME: [made]}, [view(seen, smooth)], [0])[Wiggling.NAME] == pytest.approx(2e-3)
    large = sizes_m({Motion.NAME: [made]}, [view(seen, smooth)], [0])[Motion.NAME]
    assert large == pytest.approx(np.sqrt((2 * 4e-6 + 64e-6) / 3)), "three pixels are measured"
    assert sizes_m({Motion.NAME: [made]}, [view(seen, smooth, gross_mm=7.0)], [0])[Motion.NAME] == pytest.approx(2e-3)


def test_one_surface_is_what_is_measured_where_no_other_comes_into_view() -> None:
    made = np.array([1e-3, -60e-3, np.nan, 5e-3])
    np.testing.assert_array_equal(_one_surface(made, view(np.zeros(4))), [1e-3])
    np.testing.assert_array_equal(_one_surface(made, view(np.zeros(4), gross_mm=61.0)), [1e-3, -60e-3])


def test_the_share_of_energy_is_of_all_maps_together() -> None:
    maps = {"a": [np.array([1.0, np.nan]), np.array([2.0, 0.0])], "b": [np.array([1.0, 3.0]), np.array([0.0, 0.0])]}
    assert energy_share("a", maps) == pytest.approx(5.0 / (4 + 9 + 4))
    assert energy_share("b", maps) == pytest.approx(10.0 / 17.0)
    assert energy_share("a", {"a": [np.zeros(2)]}) == 0.0


def test_a_map_is_measured_over_what_it_touches() -> None:
    made = np.array([3e-3, -4e-3, 1e-6, 0.0])
    assert mean_square(made) == pytest.approx(12.5e-6)
    assert mean_square(np.zeros(3)) == 0.0
    # The residual after it bears out a fifth of its product: 1 + 2 (3 x -1 + -4 x 1) / 25.
    assert confirmed(made, np.array([-1e-3, 1e-3, 9.0, 9.0])) == pytest.approx(1 - 14 / 25)


@pytest.mark.parametrize(
    ("vector", "sd", "bound", "covered"),
    [
        ((3.0, 4.0), 0.0, 5.0, True),
        ((3.0, 4.0), 0.0, 4.99, False),
        ((3.0, 4.0), 0.5, 4.51, True),  # its own deviation along itself is 0.5
        ((3.0, 4.0), 0.5, 4.49, False),
        ((0.0, 0.0), 0.0, 1e-9, True),
        ((0.0, 0.0), 1.0, 0.0, False),  # nothing is stated
    ],
)
def test_a_vector_within_a_bound_and_its_deviation(vector: tuple[float, float], sd: float, bound: float, *, covered: bool) -> None:
    assert _no_longer(np.array(vector), np.full(2, sd), bound) is covered


@pytest.mark.parametrize(("scale", "covered"), [(0.0009, True), (-0.0009, True), (0.0011, False), (-0.0011, False)])
def test_before_a_printed_board_its_scale_is_covered(scale: float, *, covered: bool) -> None:
    effect = DepthScale(scale=scale)
    stated: Any = SimpleNamespace(board=SimpleNamespace(print_scale_pct=0.1))
    one = Named(DepthScale.NAME, (effect,), (dict.fromkeys(effect.coefficient_names, 1e-9),), (), 1.0)
    assert calibrated(one, stated, CAMERA) is covered
    assert not calibrated(Named(Wiggling.NAME, (Wiggling(),), ({},), (), 1.0), Calibration(), CAMERA)


@pytest.mark.parametrize(
    ("won", "sure"), [((10.0, 10.0, 10.0, 10.0), 1.0), ((7.0, 7.0, 7.0, 7.0), 0.0), ((40.0, 0.0, 0.0, 0.0), 1 - 0.75**4)]
)
def test_confidence_is_the_share_of_resampled_views_in_which_an_effect_wins(won: tuple[float, ...], sure: float) -> None:
    """30 are asked for. Of 40 in one view of four, each draw that has the view wins."""
    chosen: Any = SimpleNamespace(members=(5, 7), held_out=np.full(4, 100.0), inflate=2.0)
    asked: list[Any] = []

    def score(members: Any, inflate: float) -> Any:
        asked.append((members, inflate))
        return SimpleNamespace(held_out=100.0 + np.array(won))

    judge: Any = SimpleNamespace(score=score, gain=lambda member: {5: 1e9, 7: 30.0}[member], config=SimpleNamespace(rounds=4000))
    design = SimpleNamespace(candidates={7: SimpleNamespace(name="wiggling")})
    joint: Any = SimpleNamespace(selection=SimpleNamespace(chosen=chosen), design=design)
    found = confidence(joint, judge, 1, np.random.default_rng(2))
    assert found == pytest.approx(sure, abs=0.03)
    assert asked == [([5], 2.0)]


def test_what_single_pixels_err_by_is_left_out_of_smooth_causes() -> None:
    plain = Named("a", (Wiggling(),), ({},), (), 1.0)
    rough: Any = SimpleNamespace(smooth="smooth")
    both: Any = [plain, Named("b", (rough,), ({},), (), 1.0)]
    found: Any = smooth_ones(both)
    assert found[0] is plain
    assert found[1].effects == ("smooth",)


def test_motion_is_seen_where_its_pixels_show_it_edges_among_them() -> None:
    """Maps of 1 and 2 mm, of which the pixels show one half; gross pixels, unmeasured ones and those that hardly move do not count."""
    own = np.array([1e-3, 2e-3, 1e-4, 5e-3, 2e-3])
    other = np.array([3e-3, 0.0, 0.0, 0.0, 0.0])
    residual = np.array([3.5e-3, 1e-3, 9.0, 9.0, np.nan])
    seen: Any = SimpleNamespace(residual=residual, gross=np.array([False, False, False, True, False]), sigma=np.full(5, 1e-3))
    maps = {Motion.NAME: [own], DepthScale.NAME: [other]}
    assert seen_share(Motion.NAME, maps, [seen], 3e-4) == pytest.approx(0.5)
    assert seen_share(Motion.NAME, {Motion.NAME: [-own]}, [seen], 3e-4) == 0.0
    assert seen_share(Motion.NAME, {Motion.NAME: [0.1 * own]}, [replace_residual(seen, own)], 5e-5) == 1.0
    assert seen_share(Motion.NAME, {Motion.NAME: [own]}, [seen], 1.0) == 0.0


def replace_residual(view: Any, residual: Any) -> Any:
    """The view with another residual."""
    return SimpleNamespace(**{**vars(view), "residual": residual})
