# SPDX-License-Identifier: Apache-2.0
"""A function of an observable is a form of the effect that owns the observable, or of none, and stays out of the way of formulas."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from tests.tof_gap.quiet_views import CAMERA, SHAPE, VIEWS, chain, rendering, views
from tof_align.folds import deal
from tof_gap.limits.solve import SelectLimits
from tof_gap.solve.choose.select import select
from tof_gap.solve.hypotheses.candidate import Candidate
from tof_gap.solve.hypotheses.columns import ColumnStore, build
from tof_gap.solve.hypotheses.free import OWNERS, STRAY_LIGHT, FreeFunction, curves, knots_of, observed
from tof_sensor.effects.amplitude_bias import AmplitudeBias
from tof_sensor.effects.depth_scale import DepthScale
from tof_sensor.effects.fixed_pattern import FixedPattern
from tof_sensor.effects.range_offset import RangeOffset
from tof_sensor.effects.wiggling import Wiggling

if TYPE_CHECKING:
    from tof_core.arrays import Float
    from tof_gap.seen.evidence.view import ViewEvidence
    from tof_gap.solve.choose.select import Selection

HAND_SD = np.full(6, 1e-5)
ASKED = frozenset({"wiggling"})
"""Effects whose observables are theirs: a bias of amplitude is asked by none of these tests but its own."""
NAMED = (RangeOffset(), DepthScale(), FixedPattern(), *(Wiggling(modulation_mhz=f) for f in (60.0, 80.0, 100.0)))


def selection(extra: Float) -> tuple[Selection, list[Candidate]]:
    """What is chosen where `extra` (V, H, W) metres along the ray are added to photon noise."""
    seen = views(np.random.default_rng(5), extra)
    tested = [Candidate(e.NAME, e) for e in NAMED] + curves(seen, ASKED)
    store = ColumnStore(seen, deal([0] * VIEWS, SelectLimits().folds))
    return select(build(store, tested, chain(), HAND_SD), SelectLimits()), tested


def free_function(view: ViewEvidence, name: str) -> FreeFunction:
    over = knots_of([view], name)
    assert over is not None
    return FreeFunction(name, over.at, over.means)


def radial() -> Float:
    return np.stack([rendering(0.05 * k).depth * CAMERA.ray_length() for k in range(VIEWS)])


def test_observables_that_do_not_vary_are_no_hypotheses() -> None:
    names = {c.note for c in curves(views(np.random.default_rng(0)), frozenset())}
    assert {"range_m", "amplitude", "incidence_deg", "row", "column", STRAY_LIGHT} <= names
    assert "concavity" not in names  # Nobody looked at the sky of a lone plane.


def test_columns_are_metres_along_the_ray_at_the_knots_with_the_mean_of_the_session_taken_off() -> None:
    view = views(np.random.default_rng(0))[3]
    free = free_function(view, "range_m")
    columns = free.columns(view)
    length = CAMERA.ray_length().ravel()[view.pixels]
    np.testing.assert_allclose((columns * length[:, None]).mean(axis=0), 0.0, atol=1e-12)
    np.testing.assert_allclose(columns.sum(axis=1), 0.0, atol=1e-12)  # an offset is no dependence
    values = np.linspace(-1.0, 1.0, len(free.knots))
    np.testing.assert_allclose(columns @ values, free.share(values, view).ravel()[view.pixels])
    at = observed(view, "range_m", view.pixels)
    middle = np.argmin(np.abs(at - free.knots[4]))
    mean = float(np.dot(free.means, values))
    assert columns[middle] @ values * length[middle] == pytest.approx(values[4] - mean, abs=0.01)


def test_functions_of_light_time_and_range_are_forms_of_effects_where_those_are_asked() -> None:
    assert {name: kind.NAME for name, kind in OWNERS.items()} == {
        "amplitude": "amplitude_bias",
        "time_s": "temperature_drift",
        "range_m": "wiggling",
    }
    seen = views(np.random.default_rng(0))
    owned = {c.name: c for c in curves(seen, frozenset({"amplitude_bias", "wiggling"})) if c.effect is not None}
    assert sorted(owned) == ["amplitude_bias", "wiggling"]
    light = owned["amplitude_bias"].effect
    assert isinstance(light, AmplitudeBias)
    assert knots_of(seen, "amplitude") == (light.knots, knots_of(seen, "amplitude")[1])  # type: ignore[index]
    left_out = {c.note: c for c in curves(seen, frozenset({"wiggling"}))}
    assert left_out["amplitude"].name == "unknown"  # an effect that is left out owns nothing
    assert isinstance(left_out["amplitude"].free, FreeFunction)


def test_knots_are_at_equal_numbers_of_pixels_and_at_equal_distances_and_none_close_to_another() -> None:
    seen = views(np.random.default_rng(0))
    over = knots_of(seen, "amplitude")
    assert over is not None
    value = np.concatenate([observed(v, "amplitude", v.pixels) for v in seen])
    low, high = np.quantile(value, [0.01, 0.99])
    assert over.at[0] == pytest.approx(low)
    assert over.at[-1] == pytest.approx(high)
    assert np.diff(over.at).min() > 0.02 * (high - low)
    assert np.diff(over.at).max() <= 0.2 * (high - low) + 1e-12  # six even knots
    assert sum(over.means) == pytest.approx(1.0)


def test_time_has_a_knot_for_two_views_at_most() -> None:
    seen = views(np.random.default_rng(0))
    over = knots_of(seen, "time_s")
    assert over is not None
    assert len(over.at) == min(9, VIEWS // 2)
    assert knots_of(seen[:4], "time_s") is None  # two knots are a straight line


def test_stray_light_is_a_function_of_range_over_the_pixels_own_light() -> None:
    view = views(np.random.default_rng(0))[3]
    stray = free_function(view, STRAY_LIGHT)
    columns = stray.columns(view) * CAMERA.ray_length().ravel()[view.pixels, None] + stray.means
    light = view.frame.amplitude.ravel()[view.pixels]
    np.testing.assert_allclose(columns.sum(axis=1), 1.0 / light)
    at = observed(view, "range_m", view.pixels)
    far = at >= stray.knots[-1]
    np.testing.assert_allclose(columns[far, -1], 1.0 / light[far])


def test_an_error_that_has_a_name_is_named() -> None:
    found, tested = selection(0.003 * np.cos(4 * np.pi * radial() * 80e6 / 299_792_458.0 * 4))
    assert [tested[m].name for m in found.chosen.members] == ["wiggling"]
    assert found.unknown == ()


def test_an_error_without_a_name_is_told_by_what_it_depends_on() -> None:
    seen = views(np.random.default_rng(5))
    light = np.stack([observed(v, "amplitude", np.arange(SHAPE[0] * SHAPE[1])).reshape(SHAPE) for v in seen])
    steps = np.sign(np.sin(3 * np.pi * (light - light.min()) / np.ptp(light)))
    found, tested = selection(0.003 * steps)
    assert [tested[m].name for m in found.chosen.members] == ["unknown"]
    assert found.unknown == ("amplitude",)


def test_photon_noise_is_neither_named_nor_unknown() -> None:
    found, _ = selection(np.zeros((VIEWS, *SHAPE)))
    assert found.chosen.members == ()
    assert found.unknown == ()
